"""Scripted failures played against a simulated device; how a script is written, says `simulators.fault_script`."""

import math
from collections import Counter
from collections.abc import Iterable
from typing import Protocol

from simulators.cell import CellOutput, TruthCell
from simulators.fault_script import DEVICE_KINDS, EVENTS, KINDS, LINK_KINDS, VALUE_KINDS, Fault, parse_faults
from simulators.sensors import Measurement, MeasuringLayer

__all__ = [
    "DEVICE_KINDS",
    "EVENTS",
    "KINDS",
    "LINK_KINDS",
    "VALUE_KINDS",
    "Fault",
    "FaultEngine",
    "FaultyCell",
    "FaultySensors",
    "parse_faults",
]

_FIELDS = {"voltage": "voltage_V", "current": "current_A", "temperature": "temperature_degC"}


class _Running:
    """A fault and how far it has come."""

    def __init__(self, fault: Fault) -> None:
        self.fault = fault
        self.begun_s: float | None = None
        self.left = math.inf if fault.messages is None else fault.messages
        self.done = False
        self.held: float | None = None  # what a stuck value is stuck at

    def active(self, time_s: float) -> bool:
        if self.begun_s is None or self.done:
            return False
        if self.left <= 0 or (self.fault.seconds is not None and time_s > self.begun_s + self.fault.seconds):
            self.done = True
        return not self.done


class Breakable(Protocol):
    """What a script strikes inside a device.

    Attributes
    ----------
    deaf : bool
        Set points are taken without a complaint, but the old one stays in force.
    """

    deaf: bool

    def restart(self) -> None:
        """Lose power and come back."""
        ...

    def trip(self, alarm: str) -> None:
        """Latch an alarm and switch off."""
        ...


class FaultEngine:
    """Plays a script against one device; told of every message and of the passing of time.

    Parameters
    ----------
    faults : iterable of Fault
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._running = [_Running(fault) for fault in faults]
        self._counts: Counter[str] = Counter()
        self._device: Breakable | None = None
        self.time_s = 0.0

    def bind(self, device: Breakable) -> None:
        """Say which device it is."""
        self._device = device

    @property
    def begun(self) -> tuple[Fault, ...]:
        """Faults that have begun, whether they have ended or not."""
        return tuple(running.fault for running in self._running if running.begun_s is not None)

    def message(self, events: Iterable[str]) -> list[Fault]:
        """Note a message of the client and return the link faults that it meets."""
        self._counts.update({"message", *events})
        self._begin()
        met = []
        for running in self._running:
            if running.active(self.time_s) and running.fault.kind in LINK_KINDS and self._concerns(running, events):
                running.left -= 1
                met.append(running.fault)
        return met

    def advance(self, dt_s: float) -> None:
        """Let simulated time pass."""
        self.time_s += dt_s

    def in_force(self, *kinds: str) -> list[_Running]:
        """Faults of some kinds that are there now."""
        self._begin()
        return [r for r in self._running if r.fault.kind in kinds and r.active(self.time_s)]

    def seen(self, what: str, value: float) -> float:
        """Return what a quantity is measured as, with the faults of its sensor."""
        for running in self.in_force(*VALUE_KINDS):
            if running.fault.kind != "frozen" and running.fault.what == what:  # frozen keeps the whole last measurement
                value = _wrong(running, value)
        return value

    @staticmethod
    def _concerns(running: _Running, events: Iterable[str]) -> bool:
        """A fault of samples or set-points leaves other messages alone; one by time takes whatever comes."""
        return running.fault.when in ("t", "message") or running.fault.when in events

    def _begin(self) -> None:
        for running in self._running:
            fault = running.fault
            if running.begun_s is not None:
                continue
            if self.time_s >= fault.at if fault.when == "t" else self._counts[fault.when] >= fault.at:
                running.begun_s = self.time_s
                self._strike(fault.kind)
        if self._device is not None:
            self._device.deaf = any(r.fault.kind == "refused" and r.active(self.time_s) for r in self._running)

    def _strike(self, kind: str) -> None:
        if self._device is not None and kind == "restart":
            self._device.restart()
        elif self._device is not None and kind == "watchdog":
            self._device.trip("watchdog")


class FaultyCell:
    """A cell that can warm up or short inside; otherwise the one that it wraps.

    Parameters
    ----------
    cell : TruthCell
    engine : FaultEngine
    """

    def __init__(self, cell: TruthCell, engine: FaultEngine) -> None:
        self._cell, self._engine = cell, engine
        self._warmth_K = 0.0
        self._voltage_V = cell.step(0.0, 0.0).voltage_V

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """See `simulators.cell.TruthCell`."""
        self._engine.advance(dt_s)
        for running in self._engine.in_force("over_temperature"):
            self._warmth_K += running.fault.value * dt_s
        leak_A = sum(max(self._voltage_V, 0.0) / running.fault.value for running in self._engine.in_force("short"))
        truth = self._cell.step(current_A - leak_A, dt_s)
        self._voltage_V = truth.voltage_V
        return truth._replace(temperature_degC=truth.temperature_degC + self._warmth_K)


class FaultySensors:
    """Sensors whose values can be wrong; otherwise those that it wraps.

    Parameters
    ----------
    sensors : MeasuringLayer
    engine : FaultEngine

    Attributes
    ----------
    honest : Measurement or None
        What the last measurement would have been without a fault.
    """

    def __init__(self, sensors: MeasuringLayer, engine: FaultEngine) -> None:
        self._sensors, self._engine = sensors, engine
        self.honest: Measurement | None = None

    def measure(self, truth: CellOutput, current_A: float, ambient_degC: float) -> Measurement:
        """See `simulators.sensors.Sensors`."""
        seen = self.honest = self._sensors.measure(truth, current_A, ambient_degC)
        wrong = {name: self._engine.seen(what, getattr(seen, name)) for what, name in _FIELDS.items()}
        return seen._replace(**wrong)

    @property
    def frozen(self) -> bool:
        """Whether the device has stopped measuring."""
        return bool(self._engine.in_force("frozen"))


def _wrong(running: _Running, value: float) -> float:
    kind = running.fault.kind
    if kind == "stuck":
        running.held = value if running.held is None else running.held
        return running.held
    if kind == "reversed":
        return -value
    if kind == "jump":
        return value + running.fault.value
    return math.nan if kind == "nan" else running.fault.value
