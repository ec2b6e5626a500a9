"""The traffic of each run as a BLF, ASC or candump file, written by a thread: no tick waits for a disk."""

from __future__ import annotations

import contextlib
import copy
import logging
import queue
import struct
import threading
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers.python_can import can

_log = logging.getLogger(__name__)
_WRITERS = {"blf": can.BLFWriter, "asc": can.ASCWriter, "log": can.CanutilsLogWriter}
_MOST_CHANNELS = 0xFFFF  # a BLF's field for it has 16 bits, counted from 1
WAITING_FRAMES = 200_000  # beyond that frames are dropped, and counted, before memory fills


class TrafficLog:
    """One file, from `start` to `stop`; a new one for each run.

    Parameters
    ----------
    folder : str
        Where the files go; made if it is not there. A folder whose name ends in ``.asc`` or ``.log`` gets text files,
        the latter as candump writes them; any other gets BLF.
    name : str
        Put into the files' names.
    """

    def __init__(self, folder: str, name: str) -> None:
        self._folder = Path(folder)
        self._name = name
        self._suffix = self._folder.suffix[1:] if self._folder.suffix[1:] in _WRITERS else "blf"
        self._queue: queue.Queue[can.Message | None] | None = None
        self._thread: threading.Thread | None = None
        self.dropped = 0

    def start(self) -> Path | None:
        """Begin a file and return its path; None, with a warning in the log, where it cannot be written."""
        self.stop()
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S_%fZ")
        path = self._folder / f"{self._name}_{stamp}.{self._suffix}"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            writer = _WRITERS[self._suffix](path)
        except OSError as error:
            _log.warning("CAN traffic is not logged: %s", error)
            return None
        waiting: queue.Queue[can.Message | None] = queue.Queue(WAITING_FRAMES)
        self._queue, self.dropped = waiting, 0
        self._thread = threading.Thread(target=_write, args=(writer, waiting), name="can-log", daemon=True)
        self._thread.start()
        return path

    def put(self, message: can.Message) -> None:
        """Note one frame; never waits."""
        if self._queue is not None:
            try:
                self._queue.put_nowait(message)
            except queue.Full:
                self.dropped += 1

    def stop(self) -> None:
        """End the file, if there is one."""
        waiting, thread = self._queue, self._thread
        self._queue = self._thread = None
        if waiting is None or thread is None:
            return
        if self.dropped:
            _log.warning("CAN traffic log: %d frames were dropped, the disk was too slow", self.dropped)
        with contextlib.suppress(queue.Full):
            waiting.put(None, timeout=1.0)
        thread.join(timeout=5.0)


def _write(writer: Any, waiting: queue.Queue[can.Message | None]) -> None:
    """Write what comes until None; a full disk, or a frame that no file can hold, ends the file, not the run."""
    try:
        while (message := waiting.get()) is not None:
            writer.on_message_received(_numbered(message))
    except (OSError, ValueError, struct.error) as error:
        _log.warning("CAN traffic log ended: %s", error)
    finally:
        with contextlib.suppress(OSError):
            writer.stop()


def _numbered(message: can.Message) -> can.Message:
    """A frame whose channel has no number that a file can hold, such as one named by random digits, gets none."""
    if (can.util.channel2int(message.channel) or 0) < _MOST_CHANNELS:
        return message
    nameless = copy.copy(message)
    nameless.channel = None
    return nameless
