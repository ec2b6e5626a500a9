"""A simulated bench: cell, cycler and the protocol in front of them, served until cancelled or terminated."""

import asyncio
import contextlib
import signal
import threading
import time
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from drivers.register_map import load_map
from simulators.catalogue import cell_type
from simulators.cell import Cell, TruthCell
from simulators.clocks import LockStepClock, WallClock
from simulators.cycler import Cycler, CyclerSettings
from simulators.device import MapDevice
from simulators.effects import apply_effects
from simulators.modbus_server import ModbusServer, OnRequest
from simulators.module import Module, ModuleLayout
from simulators.sensors import SensorParameters, Sensors

__all__ = ["PROTOCOLS", "SimulatorError", "SimulatorSettings", "build_device", "serve"]

PROTOCOLS = ("modbus-tcp",)
HOUSEKEEPING_S = 0.05
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
        Port 0 takes a free one.
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
    sensors : SensorParameters
        Noise, resolution and constant errors of the measurement.
    cycler : CyclerSettings
        Rating of the device; its ambient temperature follows `ambient_degC`.
    """

    protocol: str = "modbus-tcp"
    map_name: str = "generic"
    host: str = "127.0.0.1"
    port: int = 0
    cell: str = "nmc"
    effects: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    lock_step: bool = False
    speed: float = 1.0
    capacity_Ah: float | None = None
    initial_soc: float = 0.5
    ambient_degC: float = 25.0
    module: ModuleLayout | None = None
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
        if not 0 <= self.port <= 65535:
            raise ValueError(f"port is {self.port}; it must lie in 0..65535 (0: a free one)")


def build_device(
    settings: SimulatorSettings, *, cell: TruthCell | None = None, now: Callable[[], float] = time.monotonic
) -> MapDevice:
    """Put a bench together without serving it.

    Parameters
    ----------
    settings : SimulatorSettings
    cell : TruthCell, optional
        In place of the one that the settings name.
    now : Callable, optional
        Monotonic seconds.

    Raises
    ------
    ValueError
        If a cell, an effect or a value in the settings is impossible.
    drivers.register_map.BadMapError
        If the device map cannot be used.
    """
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
    cycler = Cycler(
        rating,
        cell or Cell(parameters, settings.initial_soc, settings.ambient_degC),
        Sensors(sensor_parameters, np.random.default_rng(settings.seed)),
        watchdog_enabled=not settings.lock_step,
    )
    clock = LockStepClock(now) if settings.lock_step else WallClock(now, settings.speed)
    return MapDevice(load_map(settings.map_name), cycler, clock)


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
        If the address cannot be listened on.
    ValueError, drivers.register_map.BadMapError
        As `build_device`.
    """
    device = build_device(settings, cell=cell)
    server = ModbusServer(device, on_request)
    try:
        port = await server.start(settings.host, settings.port)
    except OSError as error:
        raise SimulatorError(
            f"cannot listen on {settings.host}:{settings.port}: {error.strerror or error}; "
            "choose another port, or 0 for a free one"
        ) from error
    try:
        async with _terminated() as stop:
            on_ready(f"{settings.protocol}://{settings.host}:{port}")
            while not stop.is_set():
                device.poll()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(stop.wait(), HOUSEKEEPING_S)
    finally:
        device.rest()
        await server.close()


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
