"""Scripted failures of a simulated cycler: what fails, when it begins, and for how long.

A fault is written ``KIND[.QUANTITY][=VALUE]@WHEN[xMESSAGES][+SECONDS]``, where WHEN is ``t:SECONDS`` of simulated time
or ``EVENT:COUNT`` with an event of `EVENTS`; several are separated by semicolons::

    late=0.4@sample:30                 the 30th question for a sample is answered 0.4 s late
    nan.voltage@t:12.5+3               from 12.5 s on there is no voltage for 3 s
    exception=6@set_point:10x2         two set-points, from the tenth on, are answered with exception 6
"""

import math
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from simulators.cell import CellOutput, TruthCell
from simulators.cycler import Cycler
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

# What goes wrong with one message, and the size that it has where the script gives none.
LINK_KINDS = {
    "silence": 0.0,  # neither executed nor answered
    "lost_reply": 0.0,  # executed, not answered
    "drop": 0.0,  # the connection is closed (a line or a bus: silence)
    "delay": 0.02,  # answered later by so many seconds, but in time
    "late": 0.4,  # answered after the client's time-out
    "slow": 0.05,  # every message is answered late by so many seconds, for as long as the fault lasts
    "wrong_id": 1.0,  # answered under another unit or identifier
    "corrupt": 0.0,  # check sum or header broken (CAN: cut short)
    "exception": 4.0,  # refused with this code
    "bus_off": 0.0,  # the client's CAN controller leaves the bus (Modbus: the connection is closed)
    "echo": 0.0,  # the client hears its own message instead of an answer
}
# What goes wrong with a measured quantity.
VALUE_KINDS = {
    "stuck": 0.0,
    "nan": 0.0,
    "sentinel": 9.91e37,  # what many instruments send for "not a number" (SCPI-99, 7.2.1.5)
    "jump": 10.0,  # so much is added, in the quantity's unit
    "reversed": 0.0,
    "frozen": 0.0,  # the device stops measuring: values and their counter stay
}
# What goes wrong inside device or cell.
DEVICE_KINDS = {
    "restart": 0.0,  # switched off and on: set-point, limits and remote mode are lost
    "watchdog": 0.0,  # its communication watchdog fires
    "refused": 0.0,  # set-points are acknowledged, but the old one stays in force
    "over_temperature": 5.0,  # the cell warms by so many kelvin a second
    "short": 0.1,  # an internal short of so many ohm
}
KINDS = {**LINK_KINDS, **VALUE_KINDS, **DEVICE_KINDS}
EVENTS = ("message", "sample", "set_point", "output_on")
QUANTITIES = ("voltage", "current", "temperature")
_FIELDS = {"voltage": "voltage_V", "current": "current_A", "temperature": "temperature_degC"}
_SYNTAX = re.compile(
    r"(?P<kind>\w+)(?:\.(?P<what>\w+))?(?:=(?P<value>[-+.\deE]+))?@(?P<when>\w+):(?P<at>[.\deE+-]+?)"
    r"(?:x(?P<messages>\d+))?(?:\+(?P<seconds>[.\d]+))?"
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One line of a script.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    when : str
        "t", or one of `EVENTS`.
    at : float
        Simulated time in s, or how often the event has happened, counting the one that the fault begins with.
    value : float
        Size of the fault.
    what : str
        Quantity of a value fault.
    messages : int or None
        How many messages it lasts; None: one for a message fault, else without end.
    seconds : float or None
        How long it lasts in simulated time.
    """

    kind: str
    when: str
    at: float
    value: float
    what: Literal["voltage", "current", "temperature"] = "voltage"
    messages: int | None = None
    seconds: float | None = None


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Understand a script.

    Raises
    ------
    ValueError
        Naming the part that is wrong, and what would be right.
    """
    return tuple(_parsed(part.strip()) for part in re.split(r"[;\n]", text) if part.strip())


def _parsed(part: str) -> Fault:
    found = _SYNTAX.fullmatch(part)
    if found is None:
        raise ValueError(f"fault {part!r}: write KIND[.QUANTITY][=VALUE]@WHEN:NUMBER[xMESSAGES][+SECONDS]")
    kind, what, when = found["kind"], found["what"] or "voltage", found["when"]
    if kind not in KINDS:
        raise ValueError(f"fault {part!r}: unknown kind {kind!r}; choose one of {', '.join(KINDS)}")
    if what not in QUANTITIES:
        raise ValueError(f"fault {part!r}: unknown quantity {what!r}; choose one of {', '.join(QUANTITIES)}")
    if when != "t" and when not in EVENTS:
        raise ValueError(f"fault {part!r}: unknown event {when!r}; choose t or one of {', '.join(EVENTS)}")
    try:
        value = KINDS[kind] if found["value"] is None else float(found["value"])
        at, seconds = float(found["at"]), None if found["seconds"] is None else float(found["seconds"])
    except ValueError:
        raise ValueError(f"fault {part!r}: a number cannot be read") from None
    messages = None if found["messages"] is None else int(found["messages"])
    if messages is None and seconds is None and kind in LINK_KINDS and kind != "slow":
        messages = 1
    return Fault(kind, when, at, value, what, messages, seconds)  # pyright: ignore[reportArgumentType]


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


class FaultEngine:
    """Plays a script against one device; told of every message and of the passing of time.

    Parameters
    ----------
    faults : iterable of Fault
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._running = [_Running(fault) for fault in faults]
        self._counts: Counter[str] = Counter()
        self._cycler: Cycler | None = None
        self.time_s = 0.0

    def bind(self, cycler: Cycler) -> None:
        """Say which device it is."""
        self._cycler = cycler

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
        if self._cycler is not None:
            self._cycler.deaf = any(r.fault.kind == "refused" and r.active(self.time_s) for r in self._running)

    def _strike(self, kind: str) -> None:
        if self._cycler is not None and kind == "restart":
            self._cycler.restart()
        elif self._cycler is not None and kind == "watchdog":
            self._cycler.trip("watchdog")


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
        for running in self._engine.in_force(*VALUE_KINDS):
            if running.fault.kind != "frozen":  # the device itself keeps its last measurement then
                name = _FIELDS[running.fault.what]
                seen = seen._replace(**{name: _wrong(running, getattr(seen, name))})
        return seen

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
