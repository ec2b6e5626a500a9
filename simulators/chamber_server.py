"""A simulated chamber behind Modbus TCP: around the cell of a simulated bench, or on its own."""

import time
from collections.abc import Callable
from dataclasses import replace

from drivers.register_map import load_map
from simulators.bench_settings import SimulatorSettings
from simulators.chamber import Chamber, ChamberSettings
from simulators.chamber_device import ChamberDevice, ChamberFaults
from simulators.fault_hooks import modbus_action
from simulators.modbus_server import ModbusServer

__all__ = ["chamber_alone", "chamber_beside"]


def chamber_beside(chamber: Chamber, catch_up: Callable[[], object]) -> tuple[ChamberDevice, ModbusServer]:
    """Put a chamber in front of its map whose time somebody else moves; nothing is served yet.

    Raises
    ------
    drivers.register_map.BadMapError
        If the device map cannot be used.
    """
    device = ChamberDevice(load_map(chamber.settings.map_name, "chamber"), chamber, catch_up)
    faulty = bool(chamber.settings.faults)
    return device, ModbusServer(device, ChamberFaults(device, modbus_action) if faulty else None)


def chamber_alone(
    settings: SimulatorSettings, now: Callable[[], float] = time.monotonic
) -> tuple[ChamberDevice, ModbusServer]:
    """Put a chamber in front of its map that moves with the wall clock; otherwise as `chamber_beside`.

    Raises
    ------
    ValueError
        It is asked for in lock-step, over another protocol than Modbus TCP, or several at once.
    """
    if settings.lock_step or settings.protocol != "modbus-tcp" or settings.devices > 1:
        raise ValueError(
            "a chamber on its own has the wall clock and Modbus TCP; in lock-step it stands beside a bench"
        )
    own = replace(settings.chamber or ChamberSettings(), map_name=settings.map_name, faults=settings.faults)
    chamber, begun_s = Chamber(own, settings.ambient_degC), now()
    moved_s = 0.0

    def catch_up() -> None:
        nonlocal moved_s
        past_s = (now() - begun_s) * settings.speed
        chamber.advance(past_s - moved_s)
        moved_s = past_s

    return chamber_beside(chamber, catch_up)
