"""What time it is for a run: ticks of the wall clock, or lock-step with a simulated cycler.

Both clocks have the same methods, so that the loop does not know which one it has.
"""

import asyncio
import ctypes
import os
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

_CLOCK_MONOTONIC = 1
_TFD_NONBLOCK = os.O_NONBLOCK
_TFD_CLOEXEC = os.O_CLOEXEC
_TFD_TIMER_ABSTIME = 1
_LIBC = ctypes.CDLL(None, use_errno=True)
# Lock-step never waits for the clock; the loop's other callbacks still need their turn.
_YIELD_EVERY = 16


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick.

    Parameters
    ----------
    index : int
        Number on the grid; skips the missed ones.
    missed : int
        Ticks lost just before this one.
    lateness_s : float
        How long after its time the tick began.
    """

    index: int
    missed: int
    lateness_s: float


class Clock(Protocol):
    """Paces a run."""

    @property
    def lock_step(self) -> bool:
        """Whether the simulation waits for the ticks."""
        ...

    def start(self, period_s: float) -> None:
        """Start the grid of ticks: tick 0 is due now, tick k after ``k * period_s``."""
        ...

    async def next_tick(self) -> Tick | None:
        """Wait for the next tick; None after `interrupt`."""
        ...

    def left_s(self) -> float:
        """Return the time until the next tick."""
        ...

    def interrupt(self) -> None:
        """End the present wait and all later ones at once."""
        ...

    def sample_time_s(self, tick: Tick, monotonic_s: float) -> float:
        """Return the time of a sample since the start, read at `monotonic_s` in `tick`."""
        ...

    def elapsed_s(self, tick: Tick) -> float:
        """Return the present time since the start, in `tick`."""
        ...

    def close(self) -> None:
        """Free the timer."""
        ...


@dataclass(frozen=True, slots=True)
class Grid:
    """Ticks at ``start_s + k * period_s``."""

    start_s: float
    period_s: float

    def tick(self, last_index: int, expirations: int, now_s: float) -> Tick:
        """Return the tick that is played after `expirations` have passed since tick `last_index`.

        All but the last expiration are missed: playing them now would be a burst of old set-points.
        """
        index = last_index + expirations
        return Tick(index, expirations - 1, max(0.0, now_s - self.start_s - index * self.period_s))


class WallClock:
    """Real time, paced by a timer file descriptor (``asyncio.sleep`` alone is 1 ms late)."""

    lock_step = False

    def __init__(self, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._monotonic = monotonic
        self._grid = Grid(0.0, 1.0)
        self._index = -1
        self._fd = -1
        self._waiter: asyncio.Future[None] | None = None
        self._interrupted = False

    def start(self, period_s: float) -> None:
        """Start the grid of ticks; see `Clock`.

        Raises
        ------
        OSError
            The system gives no timer.
        """
        self._fd = _LIBC.timerfd_create(_CLOCK_MONOTONIC, _TFD_NONBLOCK | _TFD_CLOEXEC)
        if self._fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create")
        self._index = -1
        self._grid = Grid(self._monotonic(), period_s)
        setting = struct.pack("qqqq", *_timespec(period_s), *_timespec(self._grid.start_s))
        if _LIBC.timerfd_settime(self._fd, _TFD_TIMER_ABSTIME, setting, None):
            raise OSError(ctypes.get_errno(), f"timerfd_settime with a period of {period_s} s")

    async def next_tick(self) -> Tick | None:
        """Wait for the next tick; None after `interrupt`."""
        while not self._interrupted:
            expirations = self._expirations()
            if expirations:
                tick = self._grid.tick(self._index, expirations, self._monotonic())
                self._index = tick.index
                return tick
            await self._readable()
        return None

    def left_s(self) -> float:
        """Return the time until the next tick; see `Clock`."""
        return self._grid.start_s + (self._index + 1) * self._grid.period_s - self._monotonic()

    def interrupt(self) -> None:
        """End the present wait and all later ones at once."""
        self._interrupted = True
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def sample_time_s(self, tick: Tick, monotonic_s: float) -> float:
        """Return the measured time of a sample since the start."""
        return monotonic_s - self._grid.start_s

    def elapsed_s(self, tick: Tick) -> float:
        """Return the present time since the start."""
        return self._monotonic() - self._grid.start_s

    def close(self) -> None:
        """Free the timer."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _expirations(self) -> int:
        try:
            return int.from_bytes(os.read(self._fd, 8), "little")
        except BlockingIOError:
            return 0

    async def _readable(self) -> None:
        loop = asyncio.get_running_loop()
        self._waiter = loop.create_future()
        loop.add_reader(self._fd, self._wake)
        try:
            await self._waiter
        finally:
            loop.remove_reader(self._fd)
            self._waiter = None

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


class LockStepClock:
    """Simulated time: a tick is due as soon as the one before is done."""

    lock_step = True

    def __init__(self) -> None:
        self._period_s = 1.0
        self._index = -1
        self._interrupted = False

    def start(self, period_s: float) -> None:
        """Start the grid of ticks; see `Clock`."""
        self._period_s = period_s
        self._index = -1

    async def next_tick(self) -> Tick | None:
        """Return the next tick; None after `interrupt`."""
        if (self._index + 1) % _YIELD_EVERY == 0:
            await asyncio.sleep(0)
        if self._interrupted:
            return None
        self._index += 1
        return Tick(self._index, 0, 0.0)

    def left_s(self) -> float:
        """There is none: simulated time waits for the tick."""
        return 0.0

    def interrupt(self) -> None:
        """End all later waits at once."""
        self._interrupted = True

    def sample_time_s(self, tick: Tick, monotonic_s: float) -> float:
        """Return exactly ``k * dt``: the time that two runs have in common to the bit."""
        return tick.index * self._period_s

    def elapsed_s(self, tick: Tick) -> float:
        """Return the simulated time, which stands still within a tick."""
        return tick.index * self._period_s

    def close(self) -> None:
        """Nothing to free."""


def _timespec(seconds: float) -> tuple[int, int]:
    nanoseconds = round(seconds * 1e9)
    return nanoseconds // 10**9, nanoseconds % 10**9
