"""Fixtures for tests against an emulated battery behind an emulated cycler, over a real protocol, in lock-step.

In a `conftest.py`: ``pytest_plugins = ["bench_service.pytest_plugin"]``. Then

- `emulated_cell`: which cell there is (`EmulatedCell`);
- `emulated_cycler`: a cycler with that cell, served over Modbus TCP, Modbus RTU or CAN (`EmulatedCycler`);
- `bench`: plays profiles on it with the driver, the safety rules and the loop of the real bench (`EmulatedBench`).

What they are made of are fixtures too, so a test changes one by parametrising it: `emulated_protocol`,
`emulated_map`, `emulated_faults`, `emulated_seed`; or by ``@pytest.mark.emulated(cell="lfp", initial_soc=0.3, ...)``.
Simulated time moves as fast as the machine can, and the same test gives the same samples to the bit.
"""

from __future__ import annotations

import asyncio
import threading
import uuid
from collections.abc import Coroutine, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

import pytest

if TYPE_CHECKING:
    import numpy as np

    from bench_service.bench.limits import Limits
    from simulators.cycler import Cycler

T = TypeVar("T")
_PROTOCOLS = ("modbus-tcp", "modbus-rtu", "can")
_PLAY_TIMEOUT_S = 600.0
_WATCHDOG_S = 1.0
_POLL_S = 0.05


@dataclass(frozen=True)
class EmulatedCell:
    """Which cell there is; units are in the names, `effects` by their public names."""

    cell: str = "nmc"
    capacity_Ah: float | None = None
    initial_soc: float = 0.5
    ambient_degC: float = 25.0
    effects: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class EmulatedRun:
    """What a played profile gave: arrays of equal length, and how it ended.

    `state` is "completed" or "fault"; `code` and `reason` name the cause; `at_rest` says whether the cycler has
    confirmed rest. `flags` holds the quality of each sample (`bench_service.streams.Flag`), 0 is good.
    """

    time_s: np.ndarray
    current_A: np.ndarray
    voltage_V: np.ndarray
    temperature_degC: np.ndarray
    sequence: np.ndarray
    flags: np.ndarray
    state: str
    code: str
    reason: str | None
    at_rest: bool


class MemoryRecording:
    """Keeps a run's samples in memory."""

    full = False

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []

    @property
    def n_rows(self) -> int:
        """Samples so far."""
        return len(self.rows)

    def put(self, _stream: str, row: tuple[float, ...]) -> None:
        """Take one sample."""
        self.rows.append(row)


class NoFeed:
    """Nobody watches."""

    due = False

    def note_lateness(self, _lateness_s: float) -> None:
        """Nobody watches."""


class _Background:
    """An event loop in a thread, so that plain and asynchronous tests can use the same fixtures."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="emulated-bench", daemon=True)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, T], timeout_s: float = 30.0) -> T:
        """Run a coroutine there and wait for its result."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(timeout_s)

    def close(self) -> None:
        """End the thread."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(timeout=10.0)
        self._loop.close()


class EmulatedCycler:
    """A cycler that is not there, at a real address.

    Attributes
    ----------
    url, map_name : str
        What `drivers.factory.open_cycler` takes.
    cycler : Cycler
        The simulated device itself: its output, set-point, alarms, the truth behind the protocol.
    """

    def __init__(self, background: _Background, protocol: str, map_name: str, faults: str, settings: Any) -> None:
        self._background = background
        self._server: Any = None
        self._housekeeping: asyncio.Task[None] | None = None
        self.map_name = map_name
        self.url, self.cycler = background.run(self._start(protocol, faults, settings))

    async def _start(self, protocol: str, faults: str, settings: Any) -> tuple[str, Cycler]:
        from simulators.bench import build_can_device, build_device
        from simulators.can_bus import CanBusSettings
        from simulators.can_node import CanNode
        from simulators.fault_hooks import CanFaults, ModbusFaults
        from simulators.faults import FaultEngine, parse_faults
        from simulators.modbus_server import ModbusServer
        from simulators.rtu_server import RtuServer
        from simulators.serial_line import SerialSettings

        engine = FaultEngine(parse_faults(faults))
        device: Any
        if protocol == "can":
            device = build_can_device(settings, engine=engine)
            bus = CanBusSettings(interface="virtual", channel=uuid.uuid4().hex)
            self._server = CanNode(device, bus, CanFaults(device.map, engine))
            self._housekeeping = asyncio.create_task(_polled(device))
            return await self._server.start(), device.cycler
        device = build_device(settings, engine=engine)
        self._housekeeping = asyncio.create_task(_polled(device))
        hook = ModbusFaults(device.map, engine)
        if protocol == "modbus-rtu":
            line = SerialSettings(baud=921_600)
            self._server = RtuServer(device, line, hook)
            return f"modbus-rtu://{await self._server.start()}?baud={line.baud}", device.cycler
        self._server = ModbusServer(device, hook)
        return f"modbus-tcp://127.0.0.1:{await self._server.start('127.0.0.1', 0)}", device.cycler

    def close(self) -> None:
        """Stop serving."""
        self._background.run(self._stop())

    async def _stop(self) -> None:
        if self._housekeeping is not None:
            self._housekeeping.cancel()
            await asyncio.gather(self._housekeeping, return_exceptions=True)
        await self._server.close()


async def _polled(device: Any) -> None:
    """Let the device notice by itself that its client is gone."""
    while True:
        await asyncio.sleep(_POLL_S)
        device.poll()


class EmulatedBench:
    """A bench with an emulated cycler: driver, safety rules and run loop are those of a real one.

    Attributes
    ----------
    capacity_Ah : float
        Nominal capacity of the cell.
    limits : Limits
        What the cell's data sheet allows; a run may narrow them.
    """

    def __init__(self, background: _Background, cycler: EmulatedCycler, cell: EmulatedCell) -> None:
        from bench_service.bench.limits import Limits
        from simulators.catalogue import cell_type

        kind = cell_type(cell.cell)
        self._background, self._cycler, self._cell = background, cycler, cell
        self._soc: float | None = cell.initial_soc
        self.capacity_Ah = kind.parameters.capacity_Ah if cell.capacity_Ah is None else cell.capacity_Ah
        allowed = kind.limits
        self.limits: Limits = Limits(
            allowed.voltage_V, allowed.current_A, allowed.temperature_degC, (0.0, 1.0), None, 14 * 86400.0
        )

    def play(
        self,
        time_s: Sequence[float],
        current_A: Sequence[float],
        *,
        dt_s: float = 1.0,
        settle_s: float = 0.0,
        limits: Limits | None = None,
        timeout_s: float = 0.5,
    ) -> EmulatedRun:
        """Play a profile (forward hold, positive current charges) from rest to rest.

        A limit that is violated, a fault of the device or a lost link is a result, not an exception.
        """
        work = self._played(time_s, current_A, dt_s, settle_s, limits or self.limits, timeout_s)
        return self._background.run(work, _PLAY_TIMEOUT_S)

    async def _played(
        self,
        time_s: Sequence[float],
        current_A: Sequence[float],
        dt_s: float,
        settle_s: float,
        limits: Limits,
        timeout_s: float,
    ) -> EmulatedRun:
        import numpy as np

        from bench_service.bench.request import RunRequest
        from bench_service.bench.run_loop import RunLoop
        from drivers.errors import CyclerError
        from drivers.factory import open_cycler

        times, currents = np.asarray(time_s, dtype=np.float64), np.asarray(current_A, dtype=np.float64)
        request = RunRequest(
            "emulated", dt_s, limits, self.capacity_Ah, times, currents, settle_s=settle_s, initial_soc=self._soc
        )
        recording, driver = MemoryRecording(), open_cycler(self._cycler.url, self._cycler.map_name, timeout_s)
        try:
            capabilities = await driver.connect()
            plan, parts = _prepared(request, driver, capabilities.current_A, recording, timeout_s)
            end = await RunLoop(plan, parts).play()
            if end.at_rest:
                await driver.release()
        except CyclerError as error:
            return _as_run([], "fault", "connect", str(error), at_rest=False)
        finally:
            await driver.close()
        self._soc = None  # the next run begins where this one ended; only this one counted from a known charge
        return _as_run(recording.rows, end.state, end.code, end.reason, at_rest=end.at_rest)


def _prepared(request: Any, driver: Any, range_A: tuple[float, float], recording: Any, timeout_s: float) -> Any:
    """Build plan and parts of a run in lock-step."""
    from bench_service.bench.clock import LockStepClock
    from bench_service.bench.player import make_player
    from bench_service.bench.run import RunParts, RunPlan
    from bench_service.bench.safety import Rules
    from bench_service.bench.stop import StopSignal

    tolerance_A = 0.005 * max(abs(value) for value in range_A)
    rules = Rules("emulated bench", request.limits, tolerance_A, 2 * request.dt_s + timeout_s, request.dt_s)
    plan = RunPlan(request, make_player(request.time_s, request.current_A, request.dt_s), rules, _WATCHDOG_S, 1)
    feed: Any = NoFeed()
    return plan, RunParts(driver, LockStepClock(), recording, feed, StopSignal(), None, lambda *_: None)


def _as_run(rows: list[tuple[float, ...]], state: str, code: str, reason: str | None, *, at_rest: bool) -> EmulatedRun:
    import numpy as np

    table = np.array(rows, dtype=np.float64).reshape(len(rows), 9)
    return EmulatedRun(
        time_s=table[:, 0],
        current_A=table[:, 1],
        voltage_V=table[:, 2],
        temperature_degC=table[:, 3],
        sequence=table[:, 6].astype(np.int64),
        flags=table[:, 7].astype(np.int64),
        state=state,
        code=code,
        reason=reason,
        at_rest=at_rest,
    )


# --- pytest ---------------------------------------------------------------------------------------------------
def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line(
        "markers",
        "emulated(cell=, capacity_Ah=, initial_soc=, ambient_degC=, effects=, protocol=, map=, faults=, seed=): "
        "what the emulated bench of a test is made of",
    )


def _marked(request: pytest.FixtureRequest, name: str, default: Any) -> Any:
    found = [marker.kwargs[name] for marker in request.node.iter_markers("emulated") if name in marker.kwargs]
    return found[0] if found else default


@pytest.fixture
def emulated_protocol(request: pytest.FixtureRequest) -> str:
    """Return "modbus-tcp", "modbus-rtu" (a pseudo-terminal) or "can" (a virtual bus)."""
    return _marked(request, "protocol", "modbus-tcp")


@pytest.fixture
def emulated_map(request: pytest.FixtureRequest, emulated_protocol: str) -> str:
    """Return the device map: a name, or the path of a file."""
    return _marked(request, "map", "generic_can" if emulated_protocol == "can" else "generic")


@pytest.fixture
def emulated_faults(request: pytest.FixtureRequest) -> str:
    """Return what goes wrong when, see `simulators.faults`; nothing by default."""
    return _marked(request, "faults", "")


@pytest.fixture
def emulated_seed(request: pytest.FixtureRequest) -> int:
    """Return the seed of all noise."""
    return _marked(request, "seed", 0)


@pytest.fixture
def emulated_cell(request: pytest.FixtureRequest) -> EmulatedCell:
    """Return the cell; a test's marker changes it."""
    default = EmulatedCell()
    names = ("cell", "capacity_Ah", "initial_soc", "ambient_degC", "effects")
    return replace(default, **{name: _marked(request, name, getattr(default, name)) for name in names})


@pytest.fixture
def _emulation() -> Iterator[_Background]:
    background = _Background()
    yield background
    background.close()


@pytest.fixture
def emulated_cycler(
    _emulation: _Background,
    emulated_cell: EmulatedCell,
    emulated_protocol: str,
    emulated_map: str,
    emulated_faults: str,
    emulated_seed: int,
) -> Iterator[EmulatedCycler]:
    """Serve a cycler with the cell, in lock-step."""
    from simulators.bench import SimulatorSettings

    if emulated_protocol not in _PROTOCOLS:
        raise ValueError(f"emulated_protocol is {emulated_protocol!r}; choose one of {', '.join(_PROTOCOLS)}")
    settings = SimulatorSettings(
        protocol=emulated_protocol,
        map_name=emulated_map,
        cell=emulated_cell.cell,
        capacity_Ah=emulated_cell.capacity_Ah,
        initial_soc=emulated_cell.initial_soc,
        ambient_degC=emulated_cell.ambient_degC,
        effects=emulated_cell.effects,
        seed=emulated_seed,
        lock_step=True,
    )
    cycler = EmulatedCycler(_emulation, emulated_protocol, emulated_map, emulated_faults, settings)
    yield cycler
    cycler.close()


@pytest.fixture
def bench(_emulation: _Background, emulated_cycler: EmulatedCycler, emulated_cell: EmulatedCell) -> EmulatedBench:
    """Return a bench with the emulated cycler."""
    return EmulatedBench(_emulation, emulated_cycler, emulated_cell)
