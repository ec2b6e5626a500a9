"""From settings to devices: cell, sensors, cycler and clock, and the registers or messages in front of them."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from drivers.register_map import CanMap, DeviceMap, load_can_map, load_map
from simulators.bench_settings import SimulatorSettings
from simulators.can_commands import CanRefusals
from simulators.can_device import CanDevice
from simulators.catalogue import cell_type
from simulators.cell import Cell, TruthCell
from simulators.chamber import Chamber, InChamber
from simulators.clocks import LockStepClock, SimulatedClock, WallClock
from simulators.cycler import Cycler, CyclerSettings
from simulators.device import MapDevice
from simulators.ea_psb import EA_PSB, EA_PSB_CAN
from simulators.effects import apply_effects
from simulators.faults import FaultEngine, FaultyCell, FaultySensors
from simulators.modbus_refusals import ModbusRefusals
from simulators.module import Module
from simulators.sensors import MeasuringLayer, Sensors

__all__ = ["build_can_device", "build_device"]

# Devices that say no in another way than the generic cycler, by the name of their map.
MODBUS_REFUSALS: Mapping[str, ModbusRefusals] = {"ea_psb": EA_PSB}
CAN_REFUSALS: Mapping[str, CanRefusals] = {"ea_psb_can": EA_PSB_CAN}


def build_device(
    settings: SimulatorSettings,
    *,
    cell: TruthCell | None = None,
    now: Callable[[], float] = time.monotonic,
    engine: FaultEngine | None = None,
    chamber: Chamber | None = None,
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
    chamber : Chamber, optional
        Around the cell.

    Raises
    ------
    ValueError
        If a cell, an effect or a value in the settings is impossible.
    drivers.register_map.BadMapError
        If the device map cannot be used.
    """
    device_map = load_map(settings.map_name)
    refusals = MODBUS_REFUSALS.get(device_map.name, ModbusRefusals())
    return MapDevice(device_map, *_behind(_rated(settings, device_map), cell, now, (engine, chamber)), refusals)


def build_can_device(
    settings: SimulatorSettings,
    *,
    cell: TruthCell | None = None,
    now: Callable[[], float] = time.monotonic,
    engine: FaultEngine | None = None,
    chamber: Chamber | None = None,
) -> CanDevice:
    """Put a bench for CAN together without serving it; otherwise as `build_device`."""
    can_map = load_can_map(settings.map_name)
    refusals = CAN_REFUSALS.get(can_map.name, CanRefusals())
    return CanDevice(can_map, *_behind(_rated(settings, can_map), cell, now, (engine, chamber)), refusals)


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
    settings: SimulatorSettings,
    cell: TruthCell | None,
    now: Callable[[], float],
    around: tuple[FaultEngine | None, Chamber | None],
) -> tuple[Cycler, SimulatedClock]:
    """Build what stands behind the protocol: cell, cycler and clock."""
    engine, chamber = around
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
    if chamber is not None:
        cell = _in_chamber(cell, chamber)
    sensors: MeasuringLayer = Sensors(sensor_parameters, np.random.default_rng(settings.seed))
    if engine is not None:
        cell, sensors = FaultyCell(cell, engine), FaultySensors(sensors, engine)
    air_degC = None if chamber is None else lambda: chamber.air_degC
    cycler = Cycler(rating, cell, sensors, watchdog_enabled=not settings.lock_step, air_degC=air_degC)
    if engine is not None:
        engine.bind(cycler)
    clock = LockStepClock(now) if settings.lock_step else WallClock(now, settings.speed)
    return cycler, clock


def _in_chamber(cell: TruthCell, chamber: Chamber) -> InChamber:
    if not hasattr(cell, "ambient_degC"):
        raise ValueError(f"{type(cell).__name__} knows nothing around it and cannot stand in a chamber")
    return InChamber(cell, chamber)  # pyright: ignore[reportArgumentType]  # looked at above
