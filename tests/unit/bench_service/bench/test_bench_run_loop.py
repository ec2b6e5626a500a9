"""The loop with a cycler made of plain Python: every way to end is an end at rest with the output off."""

import asyncio
import math
import socket
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from bench_service.bench import judging
from bench_service.bench.chamber.in_run import RunChamber
from bench_service.bench.chamber.settings import ChamberSettings
from bench_service.bench.clock import LockStepClock, Tick, WallClock
from bench_service.bench.limits import Limits
from bench_service.bench.links import FrameLink
from bench_service.bench.live import LiveFeed
from bench_service.bench.observer_link import ObserverError, ObserverRow
from bench_service.bench.player import Player, make_player
from bench_service.bench.protocol_play import ProtocolPlay
from bench_service.bench.recording import Recording
from bench_service.bench.request import RunRequest
from bench_service.bench.run import RunParts, RunPlan
from bench_service.bench.run_loop import RunLoop
from bench_service.bench.safety import Rules
from bench_service.bench.stop import StopSignal
from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.document import read_protocol
from bench_service.protocol.program import ChamberWindow, Window
from bench_service.protocol.resuming import standing_after
from bench_service.streams import OBSERVER, SAMPLES, STEPS, STREAMS, Flag
from drivers.chamber import ChamberReading
from drivers.cycler import Capabilities, CyclerTimeoutError, DeviceLimits, Reading, SetPointRefusedError

LIMITS = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.0, 1.0), None, 100.0)
AT_REST = Reading(0.0, 0, 3.7, 0.0, 25.0, 25.0, 0.0, False, frozenset(), frozenset())


@dataclass
class FakeCycler:
    """Does what it is told; `spoil` changes or refuses the reading of a given sequence."""

    spoil: Callable[[Reading], Reading] = lambda reading: reading
    unsafe: int = 0
    reading: Reading = AT_REST
    applied: list[float] = field(default_factory=list)
    safe_calls: int = 0
    verified: int = 0
    foreign: bool = False
    asked: int = 0
    pressed_at: int | None = None  # question

    async def connect(self) -> Capabilities:
        raise NotImplementedError

    async def acquire(self, limits: DeviceLimits, watchdog_s: float, lock_step_period_s: float | None) -> None:
        await asyncio.sleep(0)

    async def output(self, on: bool) -> None:
        self.reading = replace(self.reading, output_on=on)

    async def sample(self) -> Reading:
        await asyncio.sleep(0)
        return self.spoil(self.reading)

    async def apply(self, current_A: float, hold_V: float | None = None) -> None:
        self.applied.append(current_A)
        sequence = self.reading.sequence + 1
        told = {"current_A": current_A, "setpoint_in_force_A": current_A, "voltage_V": 3.7 + 0.02 * current_A}
        self.reading = replace(self.reading, sequence=sequence, **told)

    async def safe(self) -> None:
        self.safe_calls += 1
        await asyncio.sleep(0)
        if self.safe_calls <= self.unsafe:
            raise CyclerTimeoutError("no answer")
        self.reading = replace(self.reading, output_on=False, current_A=0.0, setpoint_in_force_A=0.0)

    async def stop_input(self) -> bool | None:
        self.asked += 1
        return self.pressed_at is not None and self.asked >= self.pressed_at

    async def verify(self) -> str | None:
        self.verified += 1
        return "'watchdog' reads 60 s where 1 s was written" if self.foreign else None

    async def clear_fault(self) -> None:
        raise NotImplementedError

    async def release(self) -> None:
        raise NotImplementedError

    async def close(self) -> None:
        raise NotImplementedError


@dataclass
class Bench:
    recording: Recording
    feed: LiveFeed
    stop: StopSignal = field(default_factory=StopSignal)
    notes: list[tuple[str, str, str]] = field(default_factory=list)

    def loop(
        self,
        cycler,
        *,
        clock=None,
        capacity: int = 1000,
        observer=None,
        every: int = 1,
        max_age_s=5.0,
        player=None,
        limits=LIMITS,
    ) -> RunLoop:
        request = RunRequest("r", 0.1, limits, 3.0, np.array([0.0, 1.0]), np.array([2.0, 0.0]), initial_soc=0.5)
        rules = Rules("b", limits, current_tolerance_A=0.1, max_age_s=max_age_s, tick_s=0.1)
        player = player or make_player(request.time_s, request.current_A, request.dt_s / every)
        clock = clock or LockStepClock()
        self.stop.on_order(clock.interrupt)
        self.recording.open("r", (SAMPLES, OBSERVER, STEPS), capacity)
        parts = RunParts(cycler, clock, self.recording, self.feed, self.stop, observer, self.note)
        return RunLoop(RunPlan(request, player, rules, 1.0, every), parts)

    def note(self, severity: str, code: str, text: str) -> None:
        self.notes.append((severity, code, text))


@pytest.fixture
async def bench() -> AsyncIterator[Bench]:
    pairs = [socket.socketpair(), socket.socketpair()]
    link = FrameLink(pairs[0][0], lambda *_: None, lambda _: None)
    recording = Recording(pairs[1][0], lambda _: None)
    yield Bench(recording, LiveFeed(link))
    link.close()
    recording.shut()
    for _, theirs in pairs:
        theirs.close()


def at(sequence: int, change: Callable[[Reading], Reading]) -> Callable[[Reading], Reading]:
    return lambda reading: change(reading) if reading.output_on and reading.sequence == sequence else reading


def refuse(reading: Reading) -> Reading:
    raise SetPointRefusedError("2 A was written, 0 A is in force", reading)


def no_answer(reading: Reading) -> Reading:
    raise CyclerTimeoutError("no answer in 0.5 s")


def defect(reading: Reading) -> Reading:
    raise ZeroDivisionError


async def test_a_run_to_its_end(bench: Bench) -> None:
    cycler = FakeCycler()
    end = await bench.loop(cycler).play()
    assert (end.state, end.reason, end.at_rest) == ("completed", None, True)
    assert cycler.applied == [2.0] * 10
    assert bench.recording.n_rows == 11
    assert not cycler.reading.output_on


@pytest.mark.parametrize(
    ("change", "code", "n_rows"),
    [
        (lambda r: replace(r, voltage_V=math.nan), "voltage_limit", 5),
        (lambda r: replace(r, output_on=False), "output_off", 5),
        (lambda r: replace(r, alarms=frozenset({"internal"})), "device_alarm", 5),
        (refuse, "cycler", 5),
        (no_answer, "cycler", 4),
        (defect, "internal_error", 4),
    ],
)
async def test_faults_end_at_rest_with_the_sample_recorded(
    bench: Bench, change: Callable, code: str, n_rows: int
) -> None:
    cycler = FakeCycler(at(4, change))
    end = await bench.loop(cycler).play()
    assert (end.state, end.code, end.at_rest) == ("fault", code, True)
    assert "b" in (end.reason or "")
    assert bench.recording.n_rows == n_rows
    assert len(cycler.applied) == 4
    assert cycler.safe_calls == 1 and not cycler.reading.output_on


async def test_no_output_on_a_cell_outside_its_limits(bench: Bench) -> None:
    cycler = FakeCycler(lambda reading: replace(reading, temperature_degC=60.0))
    end = await bench.loop(cycler).play()
    assert end.code == "temperature_limit"
    assert (bench.recording.n_rows, cycler.applied, cycler.safe_calls) == (0, [], 1)


async def test_no_heartbeat_from_a_stale_reading(bench: Bench) -> None:
    cycler = FakeCycler(lambda reading: replace(reading, sequence=min(reading.sequence, 4)))
    end = await bench.loop(cycler).play()
    assert end.code == "stale_readings"
    # Samples 0 to 4 are fresh and followed by a set-point each; the three stale ones are not.
    assert len(cycler.applied) == 5
    assert bench.recording.n_rows == 8


async def test_stop_ends_before_the_next_command(bench: Bench) -> None:
    cycler = FakeCycler(at(4, lambda reading: bench.stop.give("stopped", "enough") or reading))
    end = await bench.loop(cycler).play()
    assert (end.state, end.reason) == ("stopped", "enough")
    assert len(cycler.applied) == 4 and cycler.safe_calls == 1


async def test_a_stop_that_is_older_than_the_run_never_switches_the_output_on(bench: Bench) -> None:
    switched: list[bool] = []

    class Watched(FakeCycler):
        async def output(self, on: bool) -> None:
            switched.append(on)
            await super().output(on)

    cycler = Watched()
    loop = bench.loop(cycler)
    bench.stop.give("stopped", "changed my mind")
    end = await loop.play()
    assert (end.state, end.reason, end.at_rest) == ("stopped", "changed my mind", True)
    assert (switched, cycler.applied, cycler.safe_calls) == ([], [], 1)


async def test_cancellation_brings_to_rest_first(bench: Bench) -> None:
    cycler = FakeCycler(at(4, lambda reading: task.cancel() and reading))
    task = asyncio.create_task(bench.loop(cycler).play())
    with pytest.raises(asyncio.CancelledError):
        await task
    assert cycler.safe_calls == 1 and not cycler.reading.output_on


async def test_rest_is_tried_again_and_told_if_it_is_not_confirmed(bench: Bench) -> None:
    cycler = FakeCycler(unsafe=1)
    end = await bench.loop(cycler).play()
    assert (end.state, end.at_rest, cycler.safe_calls) == ("completed", True, 2)
    cycler = FakeCycler(unsafe=9)
    end = await bench.loop(cycler).play()
    assert (end.state, end.code, end.at_rest) == ("fault", "not_at_rest", False)


async def test_on_the_wall_clock_a_full_queue_is_a_fault(bench: Bench) -> None:
    def timed(reading: Reading) -> Reading:
        return replace(reading, monotonic_s=time.monotonic())

    cycler = FakeCycler(timed)
    end = await bench.loop(cycler, clock=WallClock(), capacity=3).play()
    assert (end.state, end.code) == ("fault", "recorder")
    assert "not acknowledged the last 3 samples" in (end.reason or "")
    assert bench.recording.n_rows == 3


async def test_ticks_between_samples_command_but_do_not_record(bench: Bench) -> None:
    cycler = FakeCycler()
    end = await bench.loop(cycler, every=5).play()
    assert end.state == "completed"
    assert (bench.recording.n_rows, len(cycler.applied)) == (11, 50)


class SlowObserver:
    """Holds the loop up at the third sample for longer than a reading may be old."""

    def __init__(self) -> None:
        self.steps = 0

    def step(
        self, current_A: float, voltage_V: float, temperature_degC: float, ambient_degC: float = math.nan
    ) -> ObserverRow:
        self.steps += 1
        if self.steps == 3:
            time.sleep(1.2)
        return ObserverRow(0.5, 0.1, 3.7, 0.0)

    def new_alarms(self) -> list[str]:
        return ["the model does not fit"] if self.steps == 2 else []


async def test_no_heartbeat_from_a_reading_that_has_grown_old(bench: Bench) -> None:
    cycler = FakeCycler(lambda reading: replace(reading, monotonic_s=time.monotonic()))
    end = await bench.loop(cycler, clock=WallClock(), observer=SlowObserver(), max_age_s=1.0).play()
    assert (end.state, end.code) == ("fault", "reading_too_old")
    assert (bench.recording.n_rows, len(cycler.applied)) == (3, 2)


class DivergingObserver:
    def step(
        self, current_A: float, voltage_V: float, temperature_degC: float, ambient_degC: float = math.nan
    ) -> ObserverRow:
        raise ObserverError("the observer has diverged")

    def new_alarms(self) -> list[str]:
        return []


async def test_an_observer_that_diverges_is_told_once_and_the_run_goes_on(bench: Bench) -> None:
    end = await bench.loop(FakeCycler(), observer=DivergingObserver()).play()
    assert end.state == "completed"
    assert [(severity, code) for severity, code, _ in bench.notes] == [("warning", "observer")]


async def test_settings_are_read_back_now_and_then(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judging, "_VERIFY_PERIOD_S", 0.0)
    cycler = FakeCycler()
    end = await bench.loop(cycler).play()
    assert end.state == "completed" and cycler.verified >= 9
    end = await bench.loop(FakeCycler(foreign=True)).play()
    assert (end.state, end.code, end.at_rest) == ("fault", "second_master", True)
    assert "reads 60 s" in (end.reason or "")


async def test_a_run_is_held_and_goes_on_where_it_was(bench: Bench) -> None:
    """On the wall clock: samples go on while the output is off, the profile waits."""
    loop: RunLoop | None = None
    states: list[bool] = []

    class Held(FakeCycler):
        async def output(self, on: bool) -> None:
            states.append(on)
            await super().output(on)

        async def sample(self) -> Reading:
            if loop is not None:
                loop._parts.pause.wanted = 4 <= self.reading.sequence < 9
            return replace(await super().sample(), monotonic_s=time.monotonic())

    cycler = Held()
    loop = bench.loop(cycler, clock=WallClock())
    end = await loop.play()
    assert (end.state, end.code) == ("completed", "completed"), end
    assert states == [True, False, True]
    # All ten set-points of the profile, in their order, around those of the pause.
    assert [value for value in cycler.applied if value] == [2.0] * 10
    assert cycler.applied.count(0.0) == len(cycler.applied) - 10 >= 3
    assert bench.recording.n_rows == len(cycler.applied) + 1
    assert [code for _, code, _ in bench.notes] == ["paused", "resumed"]


SLOW = replace(LIMITS, ramp_A_per_s=5.0)
RAMP = [0.5, 1.0, 1.5, *[2.0] * 7, 1.5, 1.0, 0.5]


def ramp() -> Player:
    return make_player(0.1 * np.arange(len(RAMP) + 1), [*RAMP, 0.0], 0.1)


async def test_after_a_pause_the_current_returns_to_the_profile_within_the_ramp(bench: Bench) -> None:
    class Held(FakeCycler):
        async def output(self, on: bool) -> None:
            await super().output(on)
            self.reading = replace(self.reading, current_A=0.0, voltage_V=3.7 + 1e-6 * self.reading.sequence)

        async def sample(self) -> Reading:
            loop._parts.pause.wanted = 5 <= self.reading.sequence < 9
            return replace(await super().sample(), monotonic_s=time.monotonic())

    cycler = Held()
    loop = bench.loop(cycler, clock=WallClock(), player=ramp(), limits=SLOW)
    end = await loop.play()
    assert (end.state, end.code) == ("completed", "completed"), end
    held = [k for k, value in enumerate(cycler.applied) if value == 0.0]
    before, after = cycler.applied[: held[0]], cycler.applied[held[-1] + 1 :]
    for part in (before, after):
        assert np.abs(np.diff([0.0, *part])).max() <= 0.5 + 1e-9 and 2.0 in part


async def test_after_missed_ticks_the_current_returns_to_the_profile_within_the_ramp(bench: Bench) -> None:
    class Late(LockStepClock):
        async def next_tick(self) -> Tick | None:
            tick = await super().next_tick()
            if tick is None or tick.index != 1:
                return tick
            self._index = 4
            return Tick(4, 3, 0.0)

    cycler = FakeCycler()
    end = await bench.loop(cycler, clock=Late(), player=ramp(), limits=SLOW).play()
    assert (end.state, end.missed_ticks) == ("completed", 3), end
    assert cycler.applied == [0.5, 1.0, 1.5, *RAMP[6:]]


async def test_simulated_time_stands_still_while_a_run_is_held(bench: Bench) -> None:
    looks = 0

    class Held(FakeCycler):
        async def sample(self) -> Reading:
            nonlocal looks
            if not self.reading.output_on and self.reading.sequence:
                looks += 1
            loop._parts.pause.wanted = self.reading.sequence == 4 and looks < 3
            return await super().sample()

    cycler = Held()
    loop = bench.loop(cycler)
    end = await loop.play()
    assert end.state == "completed" and cycler.applied == [2.0] * 10 and bench.recording.n_rows == 11


async def test_a_stop_ends_a_run_that_is_held(bench: Bench) -> None:
    class Held(FakeCycler):
        async def sample(self) -> Reading:
            loop._parts.pause.wanted = self.reading.sequence >= 2
            if loop._parts.pause.active:
                bench.stop.give("stopped", "enough")
            return await super().sample()

    cycler = Held()
    loop = bench.loop(cycler)
    end = await loop.play()
    assert (end.state, end.reason, end.at_rest) == ("stopped", "enough", True)
    assert not cycler.reading.output_on


async def test_an_output_that_comes_on_in_a_pause_is_a_fault(bench: Bench) -> None:
    class Held(FakeCycler):
        async def sample(self) -> Reading:
            loop._parts.pause.wanted = self.reading.sequence >= 2
            reading = replace(await super().sample(), monotonic_s=time.monotonic())
            return replace(reading, output_on=True) if loop._parts.pause.active else reading

    loop = bench.loop(Held(), clock=WallClock())
    end = await loop.play()
    assert (end.state, end.code) == ("fault", "output_on")


async def test_a_wired_button_stops_the_run(bench: Bench) -> None:
    cycler = FakeCycler(at(4, lambda reading: replace(reading, status=frozenset({"stop_input"}))))
    end = await bench.loop(cycler).play()
    assert (end.state, end.at_rest) == ("stopped", True) and "stop input" in (end.reason or "")
    assert len(cycler.applied) == 4 and bench.recording.n_rows == 5


async def test_a_wired_button_is_asked_for_between_the_ticks_of_a_slow_run(bench: Bench) -> None:
    cycler = FakeCycler(lambda reading: replace(reading, monotonic_s=time.monotonic()), pressed_at=2)
    end = await bench.loop(cycler, clock=WallClock()).play()
    assert (end.state, end.at_rest) == ("stopped", True) and "stop input" in (end.reason or "")
    assert len(cycler.applied) == 1 and cycler.asked == 2


async def test_a_wired_button_that_is_pressed_keeps_the_output_off(bench: Bench) -> None:
    cycler = FakeCycler(lambda reading: replace(reading, status=frozenset({"stop_input"})))
    end = await bench.loop(cycler).play()
    assert end.state == "stopped" and cycler.applied == [] and bench.recording.n_rows == 0


@pytest.mark.parametrize("how", ["stop", "link"])
async def test_a_step_that_is_cut_off_counts_no_charge_beyond_the_last_stored_sample(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """Samples are stored once in 0.5 s; the run ends in between."""
    step = {"step": "constant_current", "current_A": 2.0, "until": {"time_s": 60}}
    document = {"schema": "bench-protocol-1", "name": "t", "steps": [step], "record": {"time_s": 0.5}}
    program = compile_protocol(read_protocol(document), 3.0, Window(LIMITS.voltage_V, LIMITS.current_A))
    rows: dict[str, list[tuple[float, ...]]] = {SAMPLES: [], STEPS: []}
    monkeypatch.setattr(bench.recording, "put", lambda stream, row: rows[stream].append(row))
    spoil = no_answer if how == "link" else lambda reading: bench.stop.give("stopped", "enough") or reading
    cycler = FakeCycler(at(8, spoil))
    end = await bench.loop(cycler, player=ProtocolPlay(program, 0.1)).play()
    assert end.state == ("fault" if how == "link" else "stopped")
    times_s = [row[0] for row in rows[SAMPLES]]
    (step_row,) = rows[STEPS]
    assert times_s == pytest.approx([0.0, 0.5, 0.7 if how == "link" else 0.8])
    assert step_row[0] == times_s[-1] and step_row[6] == pytest.approx(times_s[-1])
    assert step_row[7] == pytest.approx(2.0 * times_s[-1] / 3600)
    assert [row[5] for row in rows[SAMPLES]] == [0.0, 2.0, 2.0], "set-points as they were in force at the samples"


async def test_a_step_that_was_held_between_two_stored_samples_is_counted_from_them_as_it_was_played(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Held(FakeCycler):
        async def output(self, on: bool) -> None:
            await super().output(on)
            self.reading = replace(self.reading, current_A=2.0 if on else 0.0)

        async def sample(self) -> Reading:
            loop._parts.pause.wanted = 3 <= self.reading.sequence < 6
            if self.reading.sequence == 10:
                bench.stop.give("stopped", "enough")
            return replace(await super().sample(), monotonic_s=time.monotonic())

    step = {"step": "constant_current", "current_A": 2.0, "until": {"time_s": 60}}
    document = {"schema": "bench-protocol-1", "name": "t", "steps": [step], "record": {"time_s": 0.5}}
    program = compile_protocol(read_protocol(document), 3.0, Window(LIMITS.voltage_V, LIMITS.current_A))
    rows: dict[str, list[tuple[float, ...]]] = {SAMPLES: [], STEPS: []}
    monkeypatch.setattr(bench.recording, "put", lambda stream, row: rows[stream].append(row))
    loop = bench.loop(Held(), clock=WallClock(), player=ProtocolPlay(program, 0.1))
    assert (await loop.play()).state == "stopped"
    columns = dict(zip((column.name for column in STREAMS[SAMPLES]), np.array(rows[SAMPLES]).T, strict=True))
    columns["flags"] = columns["flags"].astype(np.uint32)
    held = np.flatnonzero(columns["flags"] & Flag.PAUSED)
    assert len(held) >= 3 and columns["current_A"][held[0] - 1] == 2.0, "the last sample before it is stored"
    standing = standing_after(program, None, {}, columns)
    (played,) = rows[STEPS]
    assert standing is not None
    assert (standing.step.time_s, standing.step.net_Ah) == pytest.approx((played[6], played[7]))
    assert standing.step.time_s < columns["time_s"][-1] - 0.25


@pytest.mark.parametrize("obeys", [True, False])
async def test_a_device_that_does_not_hold_the_voltage_that_it_was_told_is_a_fault(bench: Bench, obeys: bool) -> None:
    """At 2 A the voltage is 3.74 V; held are 3.72 V, which takes 1 A."""
    told_V: list[float | None] = []

    class Holding(FakeCycler):
        async def apply(self, current_A: float, hold_V: float | None = None) -> None:
            told_V.append(hold_V)
            await super().apply(current_A)
            if obeys and hold_V is not None:
                self.reading = replace(self.reading, voltage_V=hold_V, current_A=1.0)

    step = {"step": "cc_cv", "current_A": 2.0, "voltage_V": 3.72, "until": {"time_s": 3}}
    document = {"schema": "bench-protocol-1", "name": "t", "steps": [step]}
    program = compile_protocol(read_protocol(document), 3.0, Window(LIMITS.voltage_V, LIMITS.current_A))
    end = await bench.loop(Holding(), player=ProtocolPlay(program, 0.1, device_holds=True)).play()
    assert set(told_V) == {3.72}
    assert (end.state, end.code) == (("completed", "completed") if obeys else ("fault", "current_mismatch")), end


class FakeKeeper:
    """A chamber that is at 40 degC, alarms at a reading of the cycler, and notes when it is told what."""

    def __init__(self, cycler: FakeCycler, alarm_at: int = 10**9) -> None:
        self.settings = ChamberSettings("modbus-tcp://h:1", "generic_chamber", (0.0, 50.0))
        self.cycler, self.alarm_at = cycler, alarm_at
        self.told_what: list[tuple[object, int]] = []
        self.in_run, self.settled = False, True
        self.goal_degC: float | None = None

    @property
    def reading(self) -> ChamberReading:
        alarms = frozenset({"fan"} if self.cycler.reading.sequence >= self.alarm_at else ())
        return ChamberReading(0.0, 40.0, 40.0, True, frozenset(), alarms)

    async def turn(self) -> bool:
        return True

    def want(self, temperature_degC: float) -> bool:
        self.goal_degC = temperature_degC
        self.told_what.append((temperature_degC, self.cycler.safe_calls))
        return True

    def retire(self) -> None:
        self.told_what.append(("end", self.cycler.safe_calls))

    async def told(self, timeout_s: float) -> bool:
        return False


@pytest.mark.parametrize("alarm_at", [3, 10**9])
async def test_a_chamber_is_told_by_the_protocol_and_ends_after_the_cycler(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, alarm_at: int
) -> None:
    step = {"step": "constant_current", "current_A": 2.0, "until": {"time_s": 1}}
    steps = [{"step": "chamber", "temperature_degC": 40}, step]
    document = {"schema": "bench-protocol-1", "name": "t", "steps": steps}
    window = Window(LIMITS.voltage_V, LIMITS.current_A, chamber=ChamberWindow((0.0, 50.0)))
    rows: list[tuple[float, ...]] = []
    monkeypatch.setattr(bench.recording, "put", lambda stream, row: rows.append(row) if stream == SAMPLES else None)
    cycler = FakeCycler()
    loop = bench.loop(cycler, player=ProtocolPlay(compile_protocol(read_protocol(document), 3.0, window), 0.1))
    keeper = FakeKeeper(cycler, alarm_at)
    loop._chamber = RunChamber(keeper, LockStepClock())  # pyright: ignore[reportArgumentType]
    end = await loop.play()
    assert keeper.told_what[0] == (40.0, 0) and keeper.told_what[-1] == ("end", 1), "with the cycler at rest"
    assert {row[4] for row in rows} == {40.0}, "its air is what is around the cell"
    if alarm_at == 3:
        assert (end.state, end.code) == ("fault", "chamber_fault") and cycler.safe_calls == 1
        assert "the temperature chamber reports fan; output switched off" in (end.reason or "")
    else:
        assert end.state == "completed"
    assert [code for _, code, _ in bench.notes] == ["chamber_not_told"]
