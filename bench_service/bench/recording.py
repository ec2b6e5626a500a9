"""The run's rows on their way to the recorder: bounded, batched, never waiting for a disk."""

import asyncio
import contextlib
import math
import socket
from collections.abc import Callable, Sequence

from bench_service.bench.links import FrameLink
from bench_service.framing import Header
from bench_service.streams import STEPS, STREAMS, layout_to_json, pack

QUEUE_S = 60.0
LOCK_STEP_ROWS = 60_000
_BATCH_ROWS = 256
_BATCH_S = 0.1
SEAL_S = 45.0  # longer than the recorder waits for a file that somebody holds

Row = tuple[float, ...]


class RecorderError(Exception):
    """The recorder is gone, reports an error, or has stored nothing for too long."""


def queue_rows(period_s: float, lock_step: bool) -> int:
    """Return how many samples may wait for the recorder's acknowledgement: 60 s of them on the wall clock."""
    return LOCK_STEP_ROWS if lock_step else math.ceil(QUEUE_S / period_s) + 1


class Recording:
    """The control process's end of the sample link.

    The queue counts samples that the recorder has not acknowledged as committed, wherever they are on their way.

    Parameters
    ----------
    sock : socket.socket
    on_failure : callable
        Called once with the reason when the recorder is gone or reports an error.
    """

    def __init__(self, sock: socket.socket, on_failure: Callable[[str], None]) -> None:
        self._link = FrameLink(sock, self._received, self._closed)
        self._on_failure = on_failure
        self.failure: str | None = None
        self._run_id = ""
        self._capacity = 0
        self._rows: dict[str, list[Row]] = {}
        self._sent: dict[str, int] = {}
        self._acknowledged = 0
        self._flush_at: asyncio.TimerHandle | None = None
        self._room = asyncio.Event()
        self._waking = False
        self._sealed: asyncio.Future[str | None] | None = None

    def open(self, run_id: str, streams: Sequence[str], capacity: int) -> None:
        """Announce a run.

        Parameters
        ----------
        run_id : str
        streams : sequence of str
            Names out of `STREAMS`.
        capacity : int
            Samples that may wait for their acknowledgement.

        Raises
        ------
        RecorderError
            The recorder is gone.
        """
        if self._link.is_open:
            self.failure = None  # an error that ended an earlier run; the recorder itself is still there
        self._raise_failure()
        self._waking = False
        self._run_id, self._capacity, self._acknowledged = run_id, capacity, 0
        self._rows = {name: [] for name in streams}
        self._sent = dict.fromkeys(streams, 0)
        self._sealed = asyncio.get_running_loop().create_future()
        layouts = {name: layout_to_json(STREAMS[name]) for name in streams}
        self._link.send({"op": "open", "run_id": run_id, "streams": layouts})

    @property
    def is_open(self) -> bool:
        """Whether the recorder may still be there."""
        return self._link.is_open

    @property
    def n_rows(self) -> int:
        """Number of samples handed in."""
        return self._sent["samples"] + len(self._rows["samples"])

    @property
    def n_acknowledged(self) -> int:
        """Number of samples the recorder has committed."""
        return self._acknowledged

    @property
    def n_unacknowledged(self) -> int:
        """Number of samples handed in and not yet known to be committed."""
        return self.n_rows - self._acknowledged

    @property
    def full(self) -> bool:
        """Whether the queue has no room for another sample."""
        return self.n_unacknowledged >= self._capacity

    def put(self, stream: str, row: Row) -> None:
        """Take one row; never waits, and takes it even when full (see `full`).

        The fault that a full queue leads to is itself told by samples that must not be lost.
        """
        rows = self._rows[stream]
        rows.append(row)
        if stream == STEPS:
            # The end of a step is stored after the samples before it, and before those after it.
            self._flush_all()
        elif len(rows) >= _BATCH_ROWS:
            self._flush(stream)
        elif self._flush_at is None:
            self._flush_at = asyncio.get_running_loop().call_later(_BATCH_S, self._flush_all)

    async def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until the queue has room, until `wake`, or `timeout_s`; return whether the loop may go on.

        Raises
        ------
        RecorderError
            The recorder is gone.
        """
        self._flush_all()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.full and self.failure is None and not self._waking:
                    self._room.clear()
                    await self._room.wait()
        self._raise_failure()
        return not self.full or self._waking

    def wake(self) -> None:
        """End `wait_for_room` at once, now and later in this run: the run is to stop."""
        self._waking = True
        self._room.set()

    async def close(self, state: str, reason: str | None, timeout_s: float) -> str | None:
        """End the run's recording.

        Returns
        -------
        The content hash of the stored samples; None if the recorder did not seal them in `timeout_s`.
        """
        self._flush_all()
        if self._sealed is None or not self._link.is_open:
            return None
        self._link.send({"op": "close", "run_id": self._run_id, "state": state, "reason": reason})
        done, _ = await asyncio.wait({self._sealed}, timeout=timeout_s)
        return self._sealed.result() if done else None

    async def seal(self, state: str, reason: str | None) -> tuple[int, str | None, str | None]:
        """End the run's recording; return how many samples are known to be stored, their hash, and what is in doubt."""
        sha256 = await self.close(state, reason, SEAL_S)
        if sha256 is not None:
            return self.n_rows, sha256, None
        known = f"{self._acknowledged} of {self.n_rows} samples are known to be stored"
        return self._acknowledged, None, f"the recorder did not answer; {known}"

    def shut(self) -> None:
        """Close the link."""
        if self._flush_at is not None:
            self._flush_at.cancel()
        self._link.close()

    def _flush_all(self) -> None:
        if self._flush_at is not None:
            self._flush_at.cancel()
            self._flush_at = None
        for stream, rows in self._rows.items():
            if rows:
                self._flush(stream)

    def _flush(self, stream: str) -> None:
        rows, layout = self._rows[stream], STREAMS[stream]
        values = zip(*rows, strict=True)
        body = pack(layout, {column.name: value for column, value in zip(layout, values, strict=True)})
        header = {
            "op": "rows",
            "run_id": self._run_id,
            "stream": stream,
            "seq0": self._sent[stream],
            "n": len(rows),
        }
        self._sent[stream] += len(rows)
        rows.clear()
        self._link.send(header, body)

    def _received(self, header: Header, _body: bytes) -> None:
        if header["op"] == "error":
            self._fail(f"recorder: {header.get('reason')}")
        elif header.get("run_id") != self._run_id:
            return
        elif header["op"] == "ack" and header["stream"] == "samples":
            self._acknowledged = int(header["next_seq"])
            self._room.set()
        elif header["op"] == "sealed" and self._sealed is not None and not self._sealed.done():
            self._sealed.set_result(header["sha256"])

    def _closed(self, reason: str) -> None:
        if self._sealed is not None and not self._sealed.done():
            self._sealed.set_result(None)
        known = self.failure
        self._fail(f"the recorder is gone ({reason})")
        if known is not None:
            # It has said why before it went; that it is gone now is news: a new one needs a new link.
            self._on_failure(known)

    def _fail(self, reason: str) -> None:
        if self.failure is None:
            self.failure = reason
            self._room.set()
            self._on_failure(reason)

    def _raise_failure(self) -> None:
        if self.failure is not None:
            raise RecorderError(f"{self.failure}; samples cannot be stored")
