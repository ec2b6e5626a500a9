"""Keeps a recorder running, and hands its sample links to the benches."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Callable
from pathlib import Path

from bench_service.errors import BenchOfflineError, StoreError
from bench_service.recorder.client import RecorderProcess
from bench_service.store.access import FILE as META_FILE
from bench_service.store.samples import FILE as SAMPLES_FILE
from bench_service.store.watch import RESERVE_BYTES, FolderWatch, check_writable_folder

_log = logging.getLogger(__name__)
_LOOK_S = 0.5
_RESTART_S = 2.0


class RecorderKeeper:
    """The service's recorder, started again where it was killed.

    One that says itself that it cannot store any more has ended: after a failed write nobody knows what its file
    handle holds. The next is started once the directory is the one that was opened, can be written, and has room.

    Parameters
    ----------
    data_dir : Path
    on_trouble : callable
        Takes severity and one line for the people at the bench.
    """

    def __init__(self, data_dir: Path, on_trouble: Callable[[str, str], None]) -> None:
        self._data_dir = data_dir
        self._on_trouble = on_trouble
        self._recorder: RecorderProcess | None = None
        self._trouble = "not started"
        self._watch: FolderWatch | None = None
        self._watcher: asyncio.Task[None] | None = None

    @property
    def watch(self) -> FolderWatch:
        """Watch of the files that were opened at the start."""
        assert self._watch is not None
        return self._watch

    @property
    def state(self) -> str:
        """``running``, or what is wrong."""
        return "running" if self._recorder is not None else self._trouble

    @property
    def pid(self) -> int | None:
        """Process id, None where there is none."""
        return None if self._recorder is None else self._recorder.pid

    async def start(self) -> None:
        """Start the recorder; raises `StoreError` where that fails."""
        self._recorder = await asyncio.to_thread(RecorderProcess.start, self._data_dir)
        self._watch = FolderWatch(self._data_dir, META_FILE, SAMPLES_FILE)
        self._watcher = asyncio.create_task(self._keep())

    def attach(self, bench: str) -> socket.socket:
        """Give the recorder a new sample link and return its other end; raises `BenchOfflineError`."""
        if self._recorder is None:
            raise BenchOfflineError(f"bench {bench!r} cannot record: {self._trouble}")
        return self._recorder.attach(bench)

    async def stop(self) -> None:
        """Let the recorder store what it has and end; the benches have been closed before."""
        if self._watcher is not None:
            self._watcher.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._watcher
        if self._recorder is not None:
            if not await asyncio.to_thread(self._recorder.stop):
                _log.warning("the recorder still serves a bench; it ends by itself")
            self._recorder = None
            self._trouble = "stopped"

    async def _keep(self) -> None:
        while True:
            await asyncio.sleep(_LOOK_S)
            recorder = self._recorder
            if recorder is not None:
                recorder.messages()
                if recorder.failure is not None or not recorder.is_alive():
                    await self._lost(recorder)

    async def _lost(self, recorder: RecorderProcess) -> None:
        self._recorder = None
        self._trouble = recorder.failure or "the recorder process has ended"
        await asyncio.to_thread(recorder.stop)
        self._on_trouble("error", f"nothing is recorded: {self._trouble}")
        while self._recorder is None:
            try:
                self._recorder = await asyncio.to_thread(self._restarted)
                self._on_trouble("info", "the recorder is running again")
            except StoreError as error:
                self._trouble = str(error)
                await asyncio.sleep(_RESTART_S)

    def _restarted(self) -> RecorderProcess:
        self.watch.check()
        if (room := self.watch.room(2 * RESERVE_BYTES)).short:
            raise StoreError(f"the disk is full: {room.in_words()}; make room")
        check_writable_folder(self._data_dir)
        return RecorderProcess.start(self._data_dir)
