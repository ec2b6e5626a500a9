"""A temperature chamber: air that goes to a set point as fast as its heater and cooler can, and a cell in it."""

import math
from dataclasses import dataclass
from typing import Protocol

from simulators.cell import CellOutput, TruthCell
from simulators.faults import FaultEngine, parse_faults

__all__ = ["Chamber", "ChamberSettings", "InChamber", "Surrounded"]

OFF_TIME_CONSTANT_S = 3600.0  # well insulated
OVER_TEMPERATURE_K = 15.0  # above its set point: its own limiter switches it off


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberSettings:
    """A simulated chamber, and where it is served.

    Attributes
    ----------
    map_name : str
        Device map of a chamber, by name or path.
    port : int
        Of Modbus TCP; 0 takes a free one.
    ramp_K_per_min : float
        Fastest change of the air.
    time_constant_s : float
        With which the air comes to its set point in the end.
    faults : str
        A script, see `simulators.faults`; `temperature` is that of the air.
    """

    map_name: str = "generic_chamber"
    port: int = 0
    ramp_K_per_min: float = 3.0
    time_constant_s: float = 60.0
    faults: str = ""

    def __post_init__(self) -> None:
        """Refuse what no chamber is like.

        Raises
        ------
        ValueError
            If ramp or time constant are not positive, or the port is impossible.
        """
        for name in ("ramp_K_per_min", "time_constant_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"chamber: {name} is {getattr(self, name)}; it must be above 0")
        if not 0 <= self.port <= 65535:
            raise ValueError(f"chamber: port is {self.port}; it must lie in 0..65535 (0: a free one)")
        parse_faults(self.faults)


class Chamber:
    """The air in it, and what it was told; it knows time only as what `advance` is told.

    Parameters
    ----------
    settings : ChamberSettings
    room_degC : float
        Around it, and where its air begins.

    Attributes
    ----------
    air_degC, set_degC : float
    on : bool
        Whether it heats or cools; off, its air slowly goes back to the room's temperature.
    alarms : set[str]
        Latched until cleared; with one it cannot be switched on.
    deaf : bool
        Set points are taken without a complaint, but the old one stays (a fault).
    """

    def __init__(self, settings: ChamberSettings, room_degC: float = 25.0) -> None:
        self.settings = settings
        self.room_degC = room_degC
        self.air_degC = self.set_degC = room_degC
        self.on = False
        self.alarms: set[str] = set()
        self.deaf = False
        self.faults = FaultEngine(parse_faults(settings.faults))
        self.faults.bind(self)
        self._shown_degC = room_degC

    def restart(self) -> None:
        """Lose power and come back: off, set point forgotten, the air as it is."""
        self.on, self.set_degC = False, self.room_degC
        self.alarms.clear()

    def trip(self, alarm: str) -> None:
        """Latch an alarm and switch off; whatever a script calls it, a chamber says that its heater has failed."""
        self.alarms.add(alarm if alarm == "over_temperature" else "heater")
        self.on = False

    def set(self, temperature_degC: float) -> None:
        """Take a set point."""
        if not self.deaf:
            self.set_degC = temperature_degC

    def switch(self, on: bool) -> None:
        """Switch on, unless an alarm is latched, or off."""
        self.on = on and not self.alarms

    @property
    def shown_degC(self) -> float:
        """What its sensor shows."""
        if not self.faults.in_force("frozen"):
            self._shown_degC = self.faults.seen("temperature", self.air_degC)
        return self._shown_degC

    def advance(self, dt_s: float) -> None:
        """Let time pass."""
        if dt_s <= 0.0:
            return
        self.faults.advance(dt_s)
        warmed_K = sum(running.fault.value * dt_s for running in self.faults.in_force("over_temperature"))
        if self.on:
            rate_K_per_s = self.settings.ramp_K_per_min / 60.0
            self.air_degC = _towards(self.air_degC, self.set_degC, rate_K_per_s, self.settings.time_constant_s, dt_s)
        else:
            self.air_degC = _towards(self.air_degC, self.room_degC, math.inf, OFF_TIME_CONSTANT_S, dt_s)
        self.air_degC += warmed_K
        if self.on and warmed_K and self.air_degC > self.set_degC + OVER_TEMPERATURE_K:
            self.trip("over_temperature")


def _towards(value: float, target: float, rate: float, time_constant_s: float, dt_s: float) -> float:
    """Go towards a target, first as fast as may be, near it as a first-order lag does."""
    gap = target - value
    knee = rate * time_constant_s
    if abs(gap) > knee:
        fast_s = (abs(gap) - knee) / rate
        if dt_s <= fast_s:
            return value + math.copysign(rate * dt_s, gap)
        gap, dt_s = math.copysign(knee, gap), dt_s - fast_s
    return target - gap * math.exp(-dt_s / time_constant_s)


class Surrounded(TruthCell, Protocol):
    """A cell that knows what is around it."""

    ambient_degC: float


class InChamber:
    """A cell in a chamber: the chamber's time is the cell's, and its air is around the cell.

    Parameters
    ----------
    cell : Surrounded
    chamber : Chamber
    """

    def __init__(self, cell: Surrounded, chamber: Chamber) -> None:
        self._cell, self._chamber = cell, chamber

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """See `simulators.cell.TruthCell`."""
        self._chamber.advance(dt_s)
        self._cell.ambient_degC = self._chamber.air_degC
        return self._cell.step(current_A, dt_s)
