"""Steps of the wall clock, written down: all times in the records are by that clock."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable

from bench_service.bench.messages import EventMessage
from bench_service.campaign.journal import Journal

_LOOK_S = 1.0
# A clock that is disciplined runs at most 0.0005 s/s fast or slow (adjtimex); what is more in a second was a step.
SMALLEST_STEP_S = 0.25


class ClockWatch:
    """Holds the wall clock against one that nobody can set.

    Parameters
    ----------
    wall, monotonic : callable
        Seconds.
    """

    def __init__(self, wall: Callable[[], float] = time.time, monotonic: Callable[[], float] | None = None) -> None:
        self._wall = wall
        self._monotonic = monotonic or _since_boot
        self._offset_s = self._wall() - self._monotonic()

    def step_s(self) -> float:
        """Return by how much the wall clock was set since the last look, 0 where it was not."""
        offset_s = self._wall() - self._monotonic()
        step_s, self._offset_s = offset_s - self._offset_s, offset_s
        return step_s if abs(step_s) >= SMALLEST_STEP_S else 0.0

    async def watch(self, journal: Journal) -> None:
        """Note each step, until cancelled."""
        while True:
            await asyncio.sleep(_LOOK_S)
            if step_s := self.step_s():
                text = (
                    f"the clock of this machine was set {'forward' if step_s > 0 else 'back'} by {abs(step_s):.3g} s; "
                    "times before and after do not fit together, the order of events and the length of runs do"
                )
                journal.note(None, EventMessage(severity="warning", code="clock_step", text=text, run_id=None))


@contextlib.asynccontextmanager
async def watched_clock(journal: Journal) -> AsyncIterator[None]:
    """Watch the clock while the block lasts."""
    watching = asyncio.create_task(ClockWatch().watch(journal))
    try:
        yield
    finally:
        watching.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await watching


def _since_boot() -> float:
    # Goes on while the machine sleeps, as the wall clock does: waking up is no step.
    return time.clock_gettime(time.CLOCK_BOOTTIME)
