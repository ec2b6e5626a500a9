"""A run of the bench's own loop against a simulated cycler that fails by a script, and a judgement of its end."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
import time
import uuid
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench_service.bench.clock import LockStepClock, WallClock
from bench_service.bench.limits import Limits
from bench_service.bench.player import make_player
from bench_service.bench.request import RunRequest
from bench_service.bench.run import RunEnd, RunParts, RunPlan
from bench_service.bench.run_loop import RunLoop
from bench_service.bench.safety import Rules
from bench_service.bench.stop import StopSignal
from bench_service.pytest_plugin.emulated_bench import MemoryRecording, NoFeed
from bench_service.streams import SAMPLES, STREAMS
from drivers.errors import CyclerError
from drivers.factory import open_cycler
from simulators.bench import HOUSEKEEPING_S, SimulatorSettings, build_can_device, build_device
from simulators.can_bus import CanBusSettings
from simulators.can_node import CanNode
from simulators.fault_hooks import CanFaults, ModbusFaults
from simulators.faults import DEVICE_KINDS, LINK_KINDS, FaultEngine, parse_faults
from simulators.modbus_server import ModbusServer
from simulators.rtu_server import RtuServer
from simulators.serial_line import SerialSettings
from tests.protocol.rigs import TRANSPORTS

LIMITS = Limits((2.5, 4.2), (-6.0, 6.0), (0.0, 45.0), (0.0, 1.0), None, 100.0)
# A stored value this close to the truth is right. A stuck voltage is known as such when it has come for the fourth
# time; until then the relaxation of the cell takes the truth away from it by some millivolt.
CLOSE = {"voltage": 1.5e-2, "current": 2e-2, "temperature": 0.3}
TIMEOUT_S = 0.12
COLUMNS = [column.name for column in STREAMS[SAMPLES]]
DT_S, TICKS, HOLD = 0.1, 40, 5  # 4 s of pulses, a new set-point every half second
WALL_DT_S = 0.05
WATCHDOG_S = 0.4
GONE_S = 2.5  # after which a device in lock-step takes its client for dead


@dataclass
class Outcome:
    """How a run ended, and what is wrong with that (nothing, if `complaints` is empty)."""

    script: str
    transport: str
    lock_step: bool
    end: RunEnd
    begun: tuple[str, ...]
    complaints: list[str] = field(default_factory=list)
    off_after_s: float | None = None  # from the first fault to the output off: by the wall, in lock-step simulated


class Clock:
    """Monotonic time of the simulator; can be moved on."""

    def __init__(self) -> None:
        self.ahead_s = 0.0

    def __call__(self) -> float:
        return time.monotonic() + self.ahead_s


class NotedEngine(FaultEngine):
    """An engine that notes when its first fault begins."""

    def __init__(self, script: str, time_s: Callable[[], float] | None) -> None:
        super().__init__(parse_faults(script))
        self._clock_s = time_s or (lambda: self.time_s)
        self.begun_at_s: float | None = None
        self.off_at_s: float | None = None

    def _begin(self) -> None:
        super()._begin()
        if self.begun_at_s is None and self.begun:
            self.begun_at_s = self._clock_s()

    def watch(self, cycler: Any) -> None:
        """Note when the output of a cycler goes off."""
        for name in ("set_output", "restart"):
            setattr(cycler, name, self._watched(cycler, getattr(cycler, name)))

    def _watched(self, cycler: Any, switch: Callable[..., None]) -> Callable[..., None]:
        def watched(*on: bool) -> None:
            was_on = cycler.output_on
            switch(*on)
            self.off_at_s = self._clock_s() if was_on and not cycler.output_on else self.off_at_s

        return watched

    @property
    def off_after_s(self) -> float | None:
        """From the beginning of the first fault to the output off; None where either was not seen."""
        if self.begun_at_s is None or self.off_at_s is None:
            return None
        return self.off_at_s - self.begun_at_s


async def play(
    script: str,
    transport: str,
    *,
    lock_step: bool = True,
    seed: int = 0,
    timeout_s: float = TIMEOUT_S,
    ticks: int = TICKS,
    limits: Limits = LIMITS,
) -> Outcome:
    """Play pulses against a device that fails by `script`, and judge what happened."""
    engine, clock = NotedEngine(script, None if lock_step else time.monotonic), Clock()
    device, server, address = await _serve(transport, lock_step, seed, engine, clock)
    engine.watch(device.cycler)
    honest: dict[int, list[Any]] = defaultdict(list)
    most_A = _witness(device, engine, honest)
    driver = open_cycler(address, device.map.name, timeout_s)
    recording, events = MemoryRecording(), []
    housekeeping = asyncio.create_task(_polled(device))
    try:
        await driver.connect()
        end = await _loop(driver, recording, events, lock_step, seed, timeout_s, ticks, limits).play()
    except CyclerError as error:  # a bench that cannot connect does not start
        end = RunEnd("fault", "connect", str(error), True, 0)
    finally:
        housekeeping.cancel()
        await driver.close()
        clock.ahead_s += GONE_S
        device.poll()
        await server.close()
    outcome = Outcome(script, transport, lock_step, end, tuple(fault.kind for fault in engine.begun))
    outcome.off_after_s = engine.off_after_s
    _judge(outcome, device.cycler, recording.rows, honest, most_A())
    return outcome


async def _polled(device: Any) -> None:
    """Let a device look at its own watchdog though nobody asks it anything, as a simulator in its own process does."""
    while True:
        device.poll()
        await asyncio.sleep(HOUSEKEEPING_S)


async def _serve(transport: str, lock_step: bool, seed: int, engine: FaultEngine, clock: Clock) -> Any:
    is_can = transport.startswith("can")
    settings = SimulatorSettings(map_name="generic_can" if is_can else "generic", lock_step=lock_step, seed=seed)
    if is_can:
        device = build_can_device(settings, now=clock, engine=engine)
        bus = CanBusSettings()
        if transport == "can-virtual":
            bus = CanBusSettings(interface="virtual", channel=uuid.uuid4().hex)
        node = CanNode(device, bus, CanFaults(device.map, engine))
        return device, node, await node.start()
    device = build_device(settings, now=clock, engine=engine)
    hook = ModbusFaults(device.map, engine)
    if transport == "modbus-rtu":
        line = RtuServer(device, SerialSettings(baud=921_600), hook)
        return device, line, f"modbus-rtu://{await line.start()}?baud=921600"
    server = ModbusServer(device, hook)
    return device, server, f"modbus-tcp://127.0.0.1:{await server.start('127.0.0.1', 0)}"


def _witness(device: Any, engine: FaultEngine, honest: dict[int, list[Any]]) -> Any:
    """Note every true measurement by its sequence number, and the largest current that flowed."""
    cycler, most = device.cycler, [0.0]
    advance = cycler.advance

    def watched(*arguments: float) -> None:
        advance(*arguments)
        honest[cycler.sequence].append(cycler._sensors.honest)
        most[0] = max(most[0], abs(cycler.current_A))

    honest[0].append(cycler._sensors.honest or cycler.measurement)
    cycler.advance = watched
    return lambda: most[0]


def _loop(
    driver: Any,
    recording: MemoryRecording,
    events: list[Any],
    lock_step: bool,
    seed: int,
    timeout_s: float,
    ticks: int,
    limits: Limits,
) -> RunLoop:
    draw = random.Random(seed)
    dt_s = DT_S if lock_step else WALL_DT_S
    steps = ticks // HOLD
    request = RunRequest(
        "faults",
        dt_s,
        limits,
        2.5,
        np.arange(steps + 1) * HOLD * dt_s,
        np.array([draw.choice([-5.0, -3.0, 2.0, 4.0, 5.0, 0.0]) for _ in range(steps)] + [0.0]),
        settle_s=dt_s,
        initial_soc=0.5,
    )
    rules = Rules("bench", limits, current_tolerance_A=0.15, max_age_s=2 * dt_s + timeout_s + 0.1, tick_s=dt_s)
    plan = RunPlan(request, make_player(request.time_s, request.current_A, dt_s), rules, WATCHDOG_S, 1)
    clock, stop = LockStepClock() if lock_step else WallClock(), StopSignal()
    parts: Any = (driver, clock, recording, NoFeed(), stop, None, lambda *event: events.append(event))
    return RunLoop(plan, RunParts(*parts))


def _judge(
    outcome: Outcome,
    cycler: Any,
    rows: list[Any],
    honest: dict[int, list[Any]],
    most_A: float,
) -> None:
    end, complaints = outcome.end, outcome.complaints
    if cycler.output_on or cycler.set_point_A != 0.0 or cycler.current_A != 0.0:
        complaints.append(f"output {cycler.output_on}, set-point {cycler.set_point_A} A, flows {cycler.current_A} A")
    if most_A > LIMITS.current_A[1] + 0.01:
        complaints.append(f"{most_A} A flowed")
    if end.state not in ("completed", "fault") or (end.state == "fault") != bool(end.reason):
        complaints.append(f"ended as {end.state} with reason {end.reason!r}")
    if end.code == "internal_error":
        complaints.append(f"a defect: {end.reason}")
    for values in rows:
        row = dict(zip(COLUMNS, values, strict=True))
        time_s, current_A, voltage_V, temperature_degC = (row[name] for name in COLUMNS[:4])
        seen = (voltage_V, current_A, temperature_degC)
        if row["flags"] == 0 and not _right(seen, honest[int(row["device_sequence"])]):
            complaints.append(
                f"stored as good at {time_s:.2f} s: {current_A} A, {voltage_V} V, {temperature_degC} degC"
            )


def _right(stored: tuple[float, float, float], truths: list[Any]) -> bool:
    for truth in truths:
        pairs = zip(stored, (truth.voltage_V, truth.current_A, truth.temperature_degC), CLOSE.values(), strict=True)
        if all(math.isfinite(value) and abs(value - true) <= near for value, true, near in pairs):
            return True
    return False


def random_script(draw: random.Random) -> str:
    """One to three faults of random kinds, sizes and moments in the middle of a run."""
    return "; ".join(_random_fault(draw) for _ in range(draw.choice([1, 1, 1, 2, 2, 3])))


def _random_fault(draw: random.Random) -> str:
    kinds = [*LINK_KINDS, *DEVICE_KINDS, "stuck", "nan", "sentinel", "jump", "reversed", "frozen"]
    kind = draw.choice(kinds)
    text, what = kind, draw.choice(["voltage", "current", "temperature"])
    if kind in ("stuck", "nan", "sentinel", "reversed"):
        text += f".{what}"
    elif kind == "jump":
        text += f".{what}={draw.choice([-1, 1]) * draw.uniform(8, 40):.2f}"
    elif kind in ("late", "slow"):
        text += f"={draw.uniform(1.3, 3.0) * TIMEOUT_S:.3f}"
    elif kind == "delay":
        text += f"={draw.uniform(0.0, 0.02):.3f}"
    elif kind == "exception":
        text += f"={draw.randint(1, 11)}"
    elif kind == "short":
        text += f"={draw.choice([0.05, 0.2, 1.0, 5.0])}"
    elif kind == "over_temperature":
        text += f"={draw.uniform(2, 40):.1f}"
    if draw.random() < 0.4:
        text += f"@t:{draw.uniform(0.3, 3.5):.2f}"
    else:
        # A value that is wrong from before the first sample on is an offset of its sensor: that no run can tell.
        events = [("sample", 12, 40), ("set_point", 2, 40)]
        if kind in LINK_KINDS:
            events += [("message", 3, 100), ("output_on", 1, 1)]
        event, least, most = draw.choice(events)
        text += f"@{event}:{draw.randint(least, most)}"
    if kind in LINK_KINDS and draw.random() < 0.4:
        text += f"x{draw.choice([2, 3, 10, 1000])}"
    elif draw.random() < 0.3:
        text += f"+{draw.uniform(0.1, 2.0):.2f}"
    return text


def random_case(seed: int) -> tuple[str, str, bool]:
    """Script, transport and clock of a numbered case."""
    draw = random.Random(seed)
    return random_script(draw), draw.choice(TRANSPORTS), draw.random() < 0.8


async def play_case(seed: int) -> Outcome:
    """Play a numbered case; the same number is the same case."""
    script, transport, lock_step = random_case(seed)
    with contextlib.suppress(asyncio.CancelledError):
        return await play(script, transport, lock_step=lock_step, seed=seed)
    raise RuntimeError(f"case {seed} was cancelled")
