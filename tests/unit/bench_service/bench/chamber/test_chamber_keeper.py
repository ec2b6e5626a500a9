"""A chamber comes and goes, is told until it has understood, and is left as it was found where nobody needs it."""

import asyncio
import math
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field, replace

import pytest

from bench_service.bench.admission import RefusedError
from bench_service.bench.chamber import in_run, keeper
from bench_service.bench.chamber.in_run import RunChamber
from bench_service.bench.chamber.keeper import ChamberKeeper
from bench_service.bench.chamber.settings import ChamberSettings
from bench_service.bench.clock import LockStepClock, WallClock
from bench_service.bench.latch import Latch
from bench_service.bench.limits import Limits
from bench_service.bench.safety import Context, Rules, Track
from bench_service.bench.settings import BenchSettings
from drivers.chamber import ChamberIdentity, ChamberReading
from drivers.cycler import CyclerError, CyclerTimeoutError, Reading
from tests.patience import PATIENCE_S, holds, stretched

LIMITS = Limits((2, 4), (-1, 1), (0, 45), (0, 1), None, 9.0)
CHAMBER = ChamberSettings("modbus-tcp://h:1", "generic_chamber", (0.0, 50.0), lost_s=5.0)
BENCH = BenchSettings("left", "modbus-tcp://h:2", "generic", LIMITS, chamber=CHAMBER)
CELL = Reading(0.0, 1, 3.7, 0.0, 25.0, 99.0, 0.0, False, frozenset(), frozenset())


@dataclass
class FakeChamber:
    """Does what it is told; `gone` does not answer, `hangs` never does."""

    reading: ChamberReading = ChamberReading(0.0, 24.0, 20.0, False, frozenset(), frozenset())
    serial: str = "7"
    gone: bool = False
    hangs: bool = False
    told: list[object] = field(default_factory=list)

    async def _answer(self) -> None:
        if self.hangs:
            await asyncio.Event().wait()
        if self.gone:
            raise CyclerTimeoutError("no answer")

    async def connect(self) -> ChamberIdentity:
        await self._answer()
        return ChamberIdentity("box", {"maker": "m", "model": "x", "serial": self.serial, "firmware": "1"}, (-40, 90))

    async def sample(self) -> ChamberReading:
        await self._answer()
        return replace(self.reading)

    async def set(self, temperature_degC: float) -> None:
        await self._answer()
        self.told.append(temperature_degC)
        self.reading = replace(self.reading, setpoint_degC=temperature_degC, on=True)

    async def standby(self) -> None:
        await self._answer()
        self.told.append("off")
        self.reading = replace(self.reading, on=False)

    async def clear_fault(self) -> None:
        self.told.append("clear")
        self.reading = replace(self.reading, alarms=frozenset())

    async def close(self) -> None:
        pass


@pytest.fixture
def chamber(monkeypatch: pytest.MonkeyPatch) -> FakeChamber:
    fake = FakeChamber()
    monkeypatch.setattr(keeper, "open_chamber", lambda *_: fake)
    monkeypatch.setattr(keeper, "POLL_S", 0.01)
    monkeypatch.setattr(keeper, "_FIRST_RETRY_S", 0.01)
    monkeypatch.setattr(keeper, "_LEAVE_S", 0.05)
    monkeypatch.setattr(keeper, "_READY_S", 0.02)
    monkeypatch.setattr(in_run, "_END_S", 0.05)
    monkeypatch.setattr(in_run, "_LOCK_STEP_S", 0.05)
    return fake


class Kept:
    """A keeper and what it has told."""

    def __init__(self, bench: BenchSettings = BENCH) -> None:
        self.events: list[tuple[str, str, str]] = []
        self.keeper = ChamberKeeper(bench, lambda *event: self.events.append(event))

    async def __aenter__(self) -> "Kept":
        self.keeper.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.keeper.leave()

    async def there(self) -> ChamberKeeper:
        await holds(lambda: self.keeper.reading is not None, "the chamber answers")
        return self.keeper

    @property
    def codes(self) -> list[str]:
        return [code for _, code, _ in self.events]


@pytest.fixture
async def kept(chamber: FakeChamber) -> AsyncIterator[Kept]:
    async with Kept() as made:
        yield made


async def test_a_bench_without_one_is_as_it_was() -> None:
    without = ChamberKeeper(replace(BENCH, chamber=None), lambda *_: None)
    without.start()
    await without.ready()
    without.retire()
    without.clear()
    assert without.around(CELL) is CELL and without.to_json() is None and without.live() == {}
    run = RunChamber(without, LockStepClock())
    assert await run.look(CELL) is CELL and await run.end(completed=False) is None
    await run.follow(35.0)
    await without.leave()


async def test_it_is_looked_at_and_nothing_is_written(chamber: FakeChamber, kept: Kept) -> None:
    new = ChamberKeeper(BENCH, lambda *_: None)
    with pytest.raises(RefusedError, match="the chamber does not answer: not connected yet; switch it on"):
        await new.ready()
    assert math.isnan(new.around(CELL).ambient_degC), "the cycler's own sensor is not what is meant"
    kept_keeper = await kept.there()
    await kept_keeper.ready()
    assert kept_keeper.around(CELL).ambient_degC == 24.0
    assert kept_keeper.live() == {"chamber_setpoint_degC": 20.0, "chamber_on": False}
    told = kept_keeper.to_json()
    assert told == {
        "name": "box", "maker": "m", "model": "x", "serial": "7", "firmware": "1", "online": True, "reason": None,
    }  # fmt: skip
    assert chamber.told == [] and kept.events[0] == ("info", "chamber_connected", "left: box m x connected")


async def test_one_that_was_just_switched_on_is_waited_for(
    chamber: FakeChamber, kept: Kept, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = await kept.there()
    monkeypatch.setattr(keeper, "_READY_S", PATIENCE_S)
    chamber.gone = True
    await holds(lambda: made.reading is None, "gone")
    chamber.gone = False
    await made.ready()


async def test_a_run_is_refused_on_an_alarm_or_out_of_limits(chamber: FakeChamber, kept: Kept) -> None:
    made = await kept.there()
    chamber.reading = replace(chamber.reading, alarms=frozenset({"fan"}))
    await holds(lambda: "chamber_alarm" in kept.codes, "alarm told")
    with pytest.raises(RefusedError, match="the chamber reports fan"):
        await made.ready()
    made.clear()
    await holds(lambda: "clear" in chamber.told and not made.reading.alarms, "alarm cleared")
    chamber.reading = replace(chamber.reading, temperature_degC=70.0)
    await holds(lambda: made.reading.temperature_degC == 70.0, "hot")
    with pytest.raises(RefusedError, match=r"air is 70 degC, allowed are -5 to 55 degC"):
        await made.ready()
    assert chamber.told == ["clear"], "one that is off is left alone"
    chamber.reading = replace(chamber.reading, on=True)
    await holds(lambda: chamber.told[-1] == "off", "one that heats without a run is switched off")
    assert "chamber_limit" in kept.codes


async def test_one_that_comes_back_gets_its_set_point_again(chamber: FakeChamber, kept: Kept) -> None:
    made = await kept.there()
    run = RunChamber(made, WallClock())
    await run.follow(35.0)
    await holds(lambda: chamber.told == [35.0], "told")
    chamber.gone = True
    await holds(lambda: made.reading is None, "gone")
    assert math.isnan((await run.look(CELL)).ambient_degC)
    assert kept.events[-1][1] == "chamber_offline" and "no answer" in kept.events[-1][2]
    chamber.gone = False
    await holds(lambda: chamber.told == [35.0, 35.0], "told again")
    chamber.gone, chamber.serial = True, "8"
    await holds(lambda: made.reading is None, "gone")
    chamber.gone = False
    await holds(lambda: "another chamber than before" in kept.events[-1][2], "another one is not told anything")
    assert chamber.told == [35.0, 35.0]
    assert "serial number is '8', before it was '7'" in kept.events[-1][2]


@pytest.mark.parametrize(
    ("at_end", "completed", "told"),
    [("off", True, [35.0, "off"]), ("off", False, [35.0, "off"]), ("keep", False, [35.0]), (20.0, True, [35.0, 20.0])],
)
async def test_what_becomes_of_it_after_a_run_is_stated(
    chamber: FakeChamber, at_end: str | float, completed: bool, told: list[object]
) -> None:
    async with Kept(replace(BENCH, chamber=replace(CHAMBER, at_end=at_end))) as kept:
        run = RunChamber(await kept.there(), WallClock())
        await run.follow(35.0)
        await holds(lambda: chamber.told, "told")
        assert await run.end(completed=completed) is None
        assert chamber.told == told and kept.keeper.goal_degC is None, "its panel may be used"


async def test_a_run_that_has_not_set_it_leaves_it_unless_it_went_wrong(chamber: FakeChamber, kept: Kept) -> None:
    run = RunChamber(await kept.there(), WallClock())
    await run.follow(None)
    assert await run.end(completed=True) is None and chamber.told == []
    assert await RunChamber(kept.keeper, WallClock()).end(completed=False) is None
    assert chamber.told == ["off"]


async def test_what_it_has_not_taken_is_told_again_until_it_has(chamber: FakeChamber, kept: Kept) -> None:
    run = RunChamber(await kept.there(), WallClock())
    await run.follow(35.0)
    await holds(lambda: chamber.told, "told")
    chamber.gone = True
    await holds(lambda: kept.keeper.reading is None, "gone")
    text = await run.end(completed=False)
    assert text is not None and "has not confirmed its last order" in text
    chamber.gone = False
    await holds(lambda: chamber.told[-1] == "off", "switched off as soon as it is there")


async def test_after_a_process_that_died_in_a_run_it_is_switched_off(chamber: FakeChamber) -> None:
    async with Kept(replace(BENCH, latched=Latch("interrupted", "run x was interrupted"))):
        await holds(lambda: chamber.told == ["off"], "off")


async def test_on_the_wall_clock_nothing_waits_for_one_that_hangs(chamber: FakeChamber, kept: Kept) -> None:
    made = await kept.there()
    run = RunChamber(made, WallClock())
    chamber.hangs = True
    began_s = time.monotonic()
    for _ in range(1000):
        await run.look(CELL)
        await run.follow(35.0)
    assert time.monotonic() - began_s < stretched(0.5)
    assert await run.end(completed=False) is not None
    assert time.monotonic() - began_s < stretched(1.0)


async def test_in_lock_step_each_tick_has_its_own_look_but_waits_once_only(chamber: FakeChamber, kept: Kept) -> None:
    made = await kept.there()
    run = RunChamber(made, LockStepClock())
    for value in (24.0, 24.5, 25.0):
        chamber.reading = replace(chamber.reading, temperature_degC=value)
        assert (await run.look(CELL)).ambient_degC == value
    await run.follow(35.0)
    assert chamber.told == [35.0] and made.settled, "the next tick already has it"
    chamber.hangs = True
    began_s = time.monotonic()
    seen = [await run.look(CELL) for _ in range(100)]
    assert time.monotonic() - began_s < stretched(1.0) and all(math.isnan(each.ambient_degC) for each in seen)
    rules = Rules("left", LIMITS, 0.1, 1.0, 0.1)
    assert run.judge(Context(rules, Track(), 4.9, None, 0.0)) is None
    trip = run.judge(Context(rules, Track(), 5.1, None, 0.0))
    assert trip is not None and trip.code == "chamber_lost"


async def test_a_defect_is_a_chamber_that_does_not_answer(
    chamber: FakeChamber, kept: Kept, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = await kept.there()
    monkeypatch.setattr(chamber, "sample", lambda: 1 / 0)
    await holds(lambda: made.reading is None, "lost")
    assert any("internal error: ZeroDivisionError" in text for _, _, text in kept.events)
    with pytest.raises(RefusedError):
        await made.ready()
    assert not issubclass(ZeroDivisionError, CyclerError)
