"""The chamber of a bench: connected, looked at, told, and told again until it has understood.

It has a link and a task of its own. Nothing here is waited for by a tick on the wall clock, so that a chamber that is
slow or gone never holds up the cycler or a stop. A chamber that comes back within a run gets its set point again.
"""

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

from bench_service.bench.admission import RefusedError
from bench_service.bench.rest import woken
from bench_service.bench.settings import BenchSettings
from drivers.chamber import Chamber, ChamberIdentity, ChamberReading
from drivers.cycler import CyclerError, Reading, changed_identity
from drivers.factory import open_chamber

_log = logging.getLogger(__name__)
POLL_S = 1.0
_FIRST_RETRY_S, _LAST_RETRY_S = 0.2, 5.0
_LEAVE_S = 1.0
_READY_S = 3.0

Goal = float | Literal["off"] | None


def with_air(reading: Reading, chamber: ChamberReading | None) -> Reading:
    """Return a reading of the cycler with the air of a chamber around the cell; NaN where that tells nothing."""
    return replace(reading, ambient_degC=math.nan if chamber is None else chamber.temperature_degC)


class ChamberKeeper:
    """Keeps a bench's chamber, where it has one; else nothing here does anything.

    Parameters
    ----------
    bench : BenchSettings
    on_change : callable
        Takes severity, code and text of an event.

    Attributes
    ----------
    settings : ChamberSettings or None
    reading : ChamberReading or None
        The latest; None while it does not answer.
    identity : ChamberIdentity or None
        Of the chamber that was connected last.
    in_run : bool
        Whether a run looks after it.
    """

    def __init__(self, bench: BenchSettings, on_change: Callable[[str, str, str], None]) -> None:
        self.settings = bench.chamber
        self._bench = bench.name
        self._on_change = on_change
        self.reading: ChamberReading | None = None
        self.identity: ChamberIdentity | None = None
        self.in_run = False
        self._reason: str | None = "not connected yet"
        self._chamber: Chamber | None = None
        self._goal: Goal = None
        self._reached = asyncio.Event()
        self._reached.set()
        self._answers = asyncio.Event()
        self._clearing = False
        self._lock = asyncio.Lock()
        self._wake = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._told = frozenset[str]()
        self._turned_s = 0.0
        if bench.latched is not None:
            self.retire()  # a process that died in a run, or a fault, may have left it warm

    # --- what is wanted ------------------------------------------------------------------------------------

    @property
    def goal_degC(self) -> float | None:
        """Set point that it was told, or will be as soon as it answers; None where it is left as it is."""
        return None if isinstance(self._goal, str) else self._goal

    @property
    def settled(self) -> bool:
        """Whether it has been told what is wanted."""
        return self._reached.is_set()

    def want(self, temperature_degC: float) -> bool:
        """Have it go to a temperature, and stay there; return whether that is news."""
        return self._aim(temperature_degC)

    def retire(self) -> None:
        """Have it do what it does when nothing needs it any more."""
        if self.settings is not None:
            at_end = self.settings.at_end
            if at_end == "keep":
                self._goal = None
                self._reached.set()
            else:
                self._aim("off" if isinstance(at_end, str) else at_end)

    def clear(self) -> None:
        """Have its alarms acknowledged."""
        self._clearing = True
        self._wake.set()

    async def told(self, timeout_s: float) -> bool:
        """Wait until it has been told what is wanted, so long at most; return whether it has."""
        return await woken(self._reached, timeout_s)

    def _aim(self, goal: Goal) -> bool:
        if goal == self._goal:
            return False
        self._goal = goal
        self._reached.clear()
        self._wake.set()
        return True

    # --- what is known -------------------------------------------------------------------------------------

    async def answers(self) -> bool:
        """Whether it does, or does within a moment: it may have been switched on just now."""
        return await woken(self._answers, _READY_S)

    async def ready(self) -> None:
        """See that a run may begin.

        Raises
        ------
        RefusedError
            There is to be a chamber, and it does not answer, has an alarm, or is too warm or too cold.
        """
        if self.settings is None:
            return
        if not await self.answers() or self.reading is None:
            raise RefusedError(
                f"the chamber does not answer: {self._reason}; switch it on, or take it out of bench.toml"
            )
        if self.reading.alarms:
            alarms = ", ".join(sorted(self.reading.alarms))
            raise RefusedError(f"the chamber reports {alarms}; remove the cause and clear it")
        low, high = self.settings.air_degC
        if not low <= self.reading.temperature_degC <= high:
            raise RefusedError(
                f"the chamber's air is {self.reading.temperature_degC:.4g} degC, allowed are {low:g} to {high:g} degC; "
                "wait, or widen its limits"
            )

    def around(self, reading: Reading) -> Reading:
        """Return a reading of the cycler with the chamber's air as what is around the cell."""
        return reading if self.settings is None else with_air(reading, self.reading)

    def live(self) -> dict[str, Any]:
        """Return what a live frame tells of it."""
        if self.settings is None:
            return {}
        reading = self.reading
        return {
            "chamber_setpoint_degC": None if reading is None else reading.setpoint_degC,
            "chamber_on": None if reading is None else reading.on,
        }

    def to_json(self) -> dict[str, Any] | None:
        """Return what the bench's state tells of it; None where there is none."""
        if self.settings is None:
            return None
        said = {} if self.identity is None else {"name": self.identity.name, **self.identity.said}
        return {**said, "online": self.reading is not None, "reason": self._reason}

    # --- its own task --------------------------------------------------------------------------------------

    def start(self) -> None:
        """Look at it from now on."""
        if self.settings is not None:
            self._task = asyncio.get_running_loop().create_task(self._work())

    async def leave(self) -> None:
        """Tell it once more what it has not yet been told, and let it go: the process ends."""
        if self._task is None:
            return
        await self.told(_LEAVE_S)
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        if self._chamber is not None:
            await self._chamber.close()

    async def turn(self) -> bool:
        """Connect if need be, tell it what is new, look at it; return whether it has answered."""
        async with self._lock:
            try:
                return await self._turn()
            finally:
                self._turned_s = asyncio.get_running_loop().time()

    async def _turn(self) -> bool:
        try:
            chamber = self._chamber or await self._connect()
            if self._clearing:
                self._clearing = False
                await chamber.clear_fault()
            if not self._reached.is_set():
                await self._tell(chamber)
            self._took(await chamber.sample())
        except CyclerError as error:
            await self._lost(str(error))
            return False
        except Exception as error:
            # A defect here must not leave the bench with a temperature that stands still.
            _log.exception("%s: chamber", self._bench)
            await self._lost(f"internal error: {error!r}")
            return False
        return True

    async def _work(self) -> None:
        pause_s = _FIRST_RETRY_S
        while True:
            answered = await self.turn()
            pause_s = _FIRST_RETRY_S if answered else min(_LAST_RETRY_S, 2 * pause_s)
            left_s = POLL_S if answered else pause_s
            # A run in lock-step looks at it with each tick; then nothing is to be done here.
            while left_s > 0.0 and not await woken(self._wake, left_s):
                left_s = POLL_S - (asyncio.get_running_loop().time() - self._turned_s) if answered else 0.0
            self._wake.clear()

    async def _connect(self) -> Chamber:
        assert self.settings is not None  # noqa: S101  # nothing is started without
        chamber = open_chamber(self.settings.url, self.settings.map, self.settings.timeout_s)
        try:
            identity = await chamber.connect()
            if self.identity and (changed := changed_identity(self.identity.said, identity.said)) is not None:
                raise CyclerError(f"another chamber than before: {changed}; nothing was written")
        except CyclerError:
            await chamber.close()
            raise
        self._chamber, self.identity, self._reason = chamber, identity, None
        if self._goal is not None:
            self._reached.clear()  # whatever it was told before, it may have forgotten
        return chamber

    async def _tell(self, chamber: Chamber) -> None:
        goal = self._goal
        if isinstance(goal, str):
            await chamber.standby()
        elif goal is not None:
            await chamber.set(goal)
        if goal != self._goal:
            return  # something else is wanted meanwhile
        if goal == "off" or not self.in_run:
            self._goal = None  # from now on its panel may be used
        self._reached.set()

    def _took(self, reading: ChamberReading) -> None:
        back, self.reading = self.reading is None, reading
        self._answers.set()
        if back and self.identity is not None:
            words = [self.identity.name, self.identity.said.get("maker"), self.identity.said.get("model"), "connected"]
            self._on_change("info", "chamber_connected", f"{self._bench}: {' '.join(filter(None, words))}")
        if reading.alarms != self._told:
            self._told = reading.alarms
            if alarms := ", ".join(sorted(reading.alarms)):
                self._on_change("error", "chamber_alarm", f"{self._bench}: the chamber reports {alarms}")
        assert self.settings is not None  # noqa: S101  # as above
        if not self.in_run and reading.on and reading.temperature_degC > self.settings.air_degC[1]:
            text = f"the chamber's air is {reading.temperature_degC:.4g} degC without a run; it is switched off"
            if self._aim("off"):
                self._on_change("error", "chamber_limit", f"{self._bench}: {text}")

    async def _lost(self, reason: str) -> None:
        chamber, self._chamber = self._chamber, None
        if chamber is not None:
            await chamber.close()
        was, self.reading = self.reading, None
        self._answers.clear()
        if was is not None or self._reason != reason:
            self._reason = reason
            self._on_change("warning", "chamber_offline", f"{self._bench}: the chamber does not answer: {reason}")
