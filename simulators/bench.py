"""A simulated bench: cell, cycler and the protocol in front of them, served until cancelled or terminated."""

import asyncio
import contextlib
import math
import signal
import threading
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import can
import numpy as np

from drivers.register_map import CanMap, DeviceMap, load_can_map, load_map
from simulators.can_bus import CanBusSettings
from simulators.can_node import CanDevice, CanNode
from simulators.catalogue import cell_type
from simulators.cell import Cell, TruthCell
from simulators.clocks import LockStepClock, SimulatedClock, WallClock
from simulators.cycler import Cycler, CyclerSettings
from simulators.device import MapDevice
from simulators.ea_psb import EaPsb, EaPsbCan
from simulators.effects import apply_effects
from simulators.fault_hooks import CanFaults, ModbusFaults
from simulators.faults import FaultEngine, FaultyCell, FaultySensors, parse_faults
from simulators.modbus_server import ModbusServer, OnRequest
from simulators.module import Module, ModuleLayout
from simulators.rtu_server import RtuServer
from simulators.sensors import MeasuringLayer, SensorParameters, Sensors
from simulators.serial_line import SerialSettings

__all__ = ["PROTOCOLS", "SimulatorError", "SimulatorSettings", "build_can_device", "build_device", "serve"]

PROTOCOLS = ("modbus-tcp", "modbus-rtu", "can")
HOUSEKEEPING_S = 0.05
PERSONALITIES: Mapping[str, type[MapDevice]] = {"ea_psb": EaPsb}
CAN_PERSONALITIES: Mapping[str, type[CanDevice]] = {"ea_psb_can": EaPsbCan}
MOST_DEVICES = 64
MAX_SPEED = 1e5  # the work of a wall second grows with it; above, signals would wait for its end


class SimulatorError(Exception):
    """The simulator cannot start; the message says why and what to do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatorSettings:
    """What to simulate and where to serve it.

    Attributes
    ----------
    protocol : str
        One of `PROTOCOLS`.
    map_name : str
        Device map, by name or path.
    host, port : str, int
        Of Modbus TCP. Port 0 takes a free one.
    serial : SerialSettings
        Of Modbus RTU.
    can : CanBusSettings
        Of CAN.
    cell : str
        A name in `simulators.catalogue.CELLS`.
    effects : Mapping[str, float]
        Physical effects by their public name, see `simulators.effects`.
    seed : int
        Of all noise.
    lock_step : bool
        Time moves only with the client's lock-step register; otherwise with the wall clock times `speed`.
    capacity_Ah : float or None
        In place of the cell type's own.
    initial_soc, ambient_degC : float
        Where the cell starts, and the constant temperature around it.
    module : ModuleLayout or None
        A module of such cells in place of one; the cycler's rated voltage and current then count per cell.
    faults : str
        A script, see `simulators.faults`; for the first device.
    devices : int
        So many equal ones at one address: Modbus units, or CAN nodes, from the first one's number on. Each has a cell
        and noise of its own.
    sensors : SensorParameters
        Noise, resolution and constant errors of the measurement.
    cycler : CyclerSettings
        Rating of the device; its ambient temperature follows `ambient_degC`.
    """

    protocol: str = "modbus-tcp"
    map_name: str = "generic"
    host: str = "127.0.0.1"
    port: int = 0
    serial: SerialSettings = SerialSettings()
    can: CanBusSettings = CanBusSettings()
    cell: str = "nmc"
    effects: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    lock_step: bool = False
    speed: float = 1.0
    capacity_Ah: float | None = None
    initial_soc: float = 0.5
    ambient_degC: float = 25.0
    module: ModuleLayout | None = None
    faults: str = ""
    devices: int = 1
    sensors: SensorParameters = SensorParameters()
    cycler: CyclerSettings = CyclerSettings()

    def __post_init__(self) -> None:
        """Check what no part below checks.

        Raises
        ------
        ValueError
            If the protocol is unknown, or speed or port are impossible.
        """
        if self.protocol not in PROTOCOLS:
            raise ValueError(f"unknown protocol {self.protocol!r}; choose one of {', '.join(PROTOCOLS)}")
        if not 0.0 < self.speed <= MAX_SPEED:
            raise ValueError(f"speed is {self.speed}; it must be above 0 and at most {MAX_SPEED:g}")
        if not 1 <= self.devices <= MOST_DEVICES:
            raise ValueError(f"{self.devices} devices; it must be 1..{MOST_DEVICES}")
        if not 0 <= self.port <= 65535:
            raise ValueError(f"port is {self.port}; it must lie in 0..65535 (0: a free one)")


def build_device(
    settings: SimulatorSettings,
    *,
    cell: TruthCell | None = None,
    now: Callable[[], float] = time.monotonic,
    engine: FaultEngine | None = None,
) -> MapDevice:
    """Put a bench for Modbus together without serving it.

    Parameters
    ----------
    settings : SimulatorSettings
    cell : TruthCell, optional
        In place of the one that the settings name.
    now : Callable, optional
        Monotonic seconds.
    engine : FaultEngine, optional
        Plays faults inside device and cell; those of the link need the server's hook.

    Raises
    ------
    ValueError
        If a cell, an effect or a value in the settings is impossible.
    drivers.register_map.BadMapError
        If the device map cannot be used.
    """
    device_map = load_map(settings.map_name)
    make = PERSONALITIES.get(device_map.name, MapDevice)
    return make(device_map, *_behind(_rated(settings, device_map), cell, now, engine))


def build_can_device(
    settings: SimulatorSettings,
    *,
    cell: TruthCell | None = None,
    now: Callable[[], float] = time.monotonic,
    engine: FaultEngine | None = None,
) -> CanDevice:
    """Put a bench for CAN together without serving it; otherwise as `build_device`."""
    can_map = load_can_map(settings.map_name)
    make = CAN_PERSONALITIES.get(can_map.name, CanDevice)
    return make(can_map, *_behind(_rated(settings, can_map), cell, now, engine))


def _rated(settings: SimulatorSettings, device_map: DeviceMap | CanMap) -> SimulatorSettings:
    """Give the device the rating that its map states as numbers, unless the settings have one of their own."""
    if settings.cycler != CyclerSettings() or settings.module is not None:
        return settings
    watched = (
        "watchdog" in device_map.capabilities if isinstance(device_map, CanMap) else device_map.by_role("watchdog")
    )
    rating = settings.cycler if watched else replace(settings.cycler, watchdog_s=math.inf)
    current, voltage = (device_map.capabilities.get(name) for name in ("current", "voltage"))
    if current and voltage and not current[1].names and not voltage[1].names:
        rating = replace(rating, nominal_current_A=current[1].evaluate({}), nominal_voltage_V=voltage[1].evaluate({}))
    return replace(settings, cycler=rating)


def _behind(
    settings: SimulatorSettings, cell: TruthCell | None, now: Callable[[], float], engine: FaultEngine | None
) -> tuple[Cycler, SimulatedClock]:
    """Build what stands behind the protocol: cell, cycler and clock."""
    parameters = cell_type(settings.cell).parameters
    if settings.capacity_Ah is not None:
        parameters = replace(parameters, capacity_Ah=settings.capacity_Ah)
    parameters, sensor_parameters = apply_effects(parameters, settings.sensors, settings.effects)
    rating = replace(settings.cycler, ambient_degC=settings.ambient_degC)
    if settings.module is not None:
        rating = replace(
            rating,
            nominal_voltage_V=rating.nominal_voltage_V * settings.module.cells_in_series,
            nominal_current_A=rating.nominal_current_A * settings.module.cells_in_parallel,
        )
        cell = cell or Module(parameters, settings.module, settings.initial_soc, settings.ambient_degC)
    cell = cell or Cell(parameters, settings.initial_soc, settings.ambient_degC)
    sensors: MeasuringLayer = Sensors(sensor_parameters, np.random.default_rng(settings.seed))
    if engine is not None:
        cell, sensors = FaultyCell(cell, engine), FaultySensors(sensors, engine)
    cycler = Cycler(rating, cell, sensors, watchdog_enabled=not settings.lock_step)
    if engine is not None:
        engine.bind(cycler)
    clock = LockStepClock(now) if settings.lock_step else WallClock(now, settings.speed)
    return cycler, clock


async def serve(
    settings: SimulatorSettings,
    on_ready: Callable[[str], None],
    *,
    cell: TruthCell | None = None,
    on_request: OnRequest | None = None,
) -> None:
    """Serve a simulated bench until the task is cancelled or the process gets SIGTERM.

    Parameters
    ----------
    settings : SimulatorSettings
    on_ready : Callable
        Called once with the address, such as ``modbus-tcp://127.0.0.1:1502``, when clients can connect.
    cell : TruthCell, optional
        In place of the one that the settings name.
    on_request : Callable, optional
        Fault seam of `simulators.modbus_server.ModbusServer`.

    Raises
    ------
    SimulatorError
        If the address cannot be listened on, or the serial line not be opened.
    ValueError, drivers.register_map.BadMapError
        As `build_device`.
    """
    devices, servers, address = await _start(settings, cell, on_request)
    try:
        async with _terminated() as stop:
            on_ready(address)
            while not stop.is_set():
                for device in devices:
                    device.poll()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(stop.wait(), HOUSEKEEPING_S)
    finally:
        for device in devices:
            device.rest()
        for server in servers:
            await server.close()


Started = tuple[Sequence[MapDevice | CanDevice], Sequence[ModbusServer | RtuServer | CanNode], str]


def _others(settings: SimulatorSettings) -> list[SimulatorSettings]:
    """Settings of the devices beside the first: other seeds, no faults."""
    return [replace(settings, seed=settings.seed + index, faults="") for index in range(1, settings.devices)]


async def _start_nodes(settings: SimulatorSettings, cell: TruthCell | None, engine: FaultEngine | None) -> Started:
    first = build_can_device(settings, cell=cell, engine=engine)
    nodes = [CanNode(first, settings.can, CanFaults(first.map, engine) if engine else None)]
    for index, other in enumerate(_others(settings), 1):
        bus = replace(nodes[0].settings, node=nodes[0].settings.node + index)
        nodes.append(CanNode(build_can_device(other), bus))
    try:
        addresses = [await node.start() for node in nodes]
    except (OSError, can.CanError) as error:
        raise SimulatorError(f"cannot join {nodes[0].address}: {error}; choose another --channel") from error
    return [node.device for node in nodes], nodes, addresses[0]


async def _start(settings: SimulatorSettings, cell: TruthCell | None, on_request: OnRequest | None) -> Started:
    """Build the devices, put the protocol in front of them; return both with the address that clients use."""
    engine = FaultEngine(parse_faults(settings.faults)) if settings.faults else None
    if settings.protocol == "can":
        return await _start_nodes(settings, cell, engine)
    device = build_device(settings, cell=cell, engine=engine)
    if engine is not None:
        on_request = ModbusFaults(device.map, engine)
    others = [build_device(other) for other in _others(settings)]
    neighbours = {device.map.unit_id + index: other for index, other in enumerate(others, 1)}
    if settings.protocol == "modbus-rtu":
        line = settings.serial
        server = RtuServer(device, line, on_request, neighbours)
        try:
            name = await server.start()
        except OSError as error:
            raise SimulatorError(
                f"cannot open {line.device or 'a pseudo-terminal'}: {error.strerror or error}; choose another --device"
            ) from error
        options = "" if (line.parity, line.stopbits) == ("N", 1) else f"&parity={line.parity}&stopbits={line.stopbits}"
        return [device, *others], [server], f"modbus-rtu://{name}?baud={line.baud}{options}"
    server = ModbusServer(device, on_request, neighbours)
    try:
        port = await server.start(settings.host, settings.port)
    except OSError as error:
        raise SimulatorError(
            f"cannot listen on {settings.host}:{settings.port}: {error.strerror or error}; "
            "choose another port, or 0 for a free one"
        ) from error
    return [device, *others], [server], f"modbus-tcp://{settings.host}:{port}"


@contextlib.asynccontextmanager
async def _terminated() -> AsyncIterator[asyncio.Event]:
    """Yield an event that SIGTERM sets; signals reach the main thread's loop alone."""
    stop = asyncio.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, stop.set)
    try:
        yield stop
    finally:
        loop.remove_signal_handler(signal.SIGTERM)
