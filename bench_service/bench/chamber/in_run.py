"""The chamber in a run: looked at with each sample, told what the protocol wants, brought to its end after the cycler.

On the wall clock a tick takes what the chamber's own task has read last, and waits for nothing. In lock-step, where
time stands still meanwhile, a tick asks the chamber itself, for equal runs to be equal to the bit; but never for long,
and not again before a chamber that was late has answered.
"""

import asyncio

from bench_service.bench.chamber import rules
from bench_service.bench.chamber.keeper import ChamberKeeper, with_air
from bench_service.bench.clock import Clock
from bench_service.bench.safety import Context, Trip
from drivers.chamber import ChamberReading
from drivers.cycler import Reading

_LOCK_STEP_S = 0.5
_END_S = 1.5


class RunChamber:
    """Follows a bench's chamber through one run.

    Parameters
    ----------
    keeper : ChamberKeeper or None
    clock : Clock
    """

    def __init__(self, keeper: ChamberKeeper | None, clock: Clock) -> None:
        self._keeper = None if keeper is None or keeper.settings is None else keeper
        self._clock = clock
        self._known = rules.Known()
        self._late: ChamberReading | None = None  # the last reading before it was late
        self._waits = True
        self._set = False
        self._turn: asyncio.Future[bool] | None = None
        if self._keeper is not None:
            self._keeper.in_run = True

    async def look(self, reading: Reading) -> Reading:
        """Return a reading of the cycler with the temperature of the chamber's air."""
        if self._keeper is None:
            return reading
        await self._asked()
        return with_air(reading, self._current)

    def judge(self, context: Context) -> Trip | None:
        """Return why the output must go off."""
        keeper = self._keeper
        if keeper is None or keeper.settings is None:
            return None
        told_degC = keeper.goal_degC if keeper.settled else None
        self._known = rules.follow(self._known, self._current, context.now_s, told_degC)
        return rules.check(self._known, keeper.settings, context)

    async def follow(self, temperature_degC: float | None) -> None:
        """Hand over what the protocol wants of it."""
        if self._keeper is not None and temperature_degC is not None:
            self._set = True
            if self._keeper.want(temperature_degC):
                await self._asked()

    async def end(self, *, completed: bool) -> str | None:
        """Let it come to its end, with the cycler at rest.

        A run that was completed and has not set it leaves it as it was. What it has not taken yet it is told again
        until it has.

        Returns
        -------
        None, or what people must know.
        """
        keeper = self._keeper
        if keeper is None:
            return None
        keeper.in_run = False
        if completed and not self._set:
            return None
        keeper.retire()
        if await keeper.told(_END_S):
            return None
        return "the temperature chamber has not confirmed its last order; it is told again"

    @property
    def _current(self) -> ChamberReading | None:
        """The latest reading; in lock-step there is none of this time where the chamber is late."""
        return self._keeper.reading if self._keeper is not None and self._waits else None

    async def _asked(self) -> None:
        keeper = self._keeper
        if keeper is None or not self._clock.lock_step:
            return
        if not self._waits and keeper.reading is not None and keeper.reading is not self._late:
            self._waits = True
        if not self._waits:
            return
        # One that is late goes on by itself: to cancel it would cost the connection.
        self._turn = asyncio.ensure_future(keeper.turn())
        done, _ = await asyncio.wait({self._turn}, timeout=_LOCK_STEP_S)
        if not done:
            self._waits, self._late = False, keeper.reading
