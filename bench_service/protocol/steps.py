"""What a protocol is made of: steps, ends, records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from bench_service.errors import Where

SCHEMA = "bench-protocol-1"
# quantity of an end -> unit
ENDS: Mapping[str, str] = MappingProxyType(
    {
        "voltage_V": "V",
        "current_A": "A",
        "rate_C": "C",
        "time_s": "s",
        "charge_Ah": "Ah",
        "charge_share": "of the capacity",
        "soc": "",
        "temperature_degC": "degC",
        "dV_dt_V_per_s": "V/s",
    }
)
# What is known without a step that plays: where a goto looks, and a loop or group between its steps.
STATES = ("voltage_V", "soc", "temperature_degC", "charge_Ah", "charge_share", "cycle")
SLOPE_OVER_S = 60.0


@dataclass(frozen=True, slots=True)
class Bound:
    """One end of a step, or a condition: a quantity above or below a value.

    Attributes
    ----------
    above : bool or None
        None: in the direction in which the step's current moves it.
    over_s : float
        For ``dV_dt_V_per_s``: the time over which the slope is taken.
    """

    quantity: str
    value: float
    above: bool | None = None
    over_s: float = SLOPE_OVER_S


@dataclass(frozen=True, slots=True)
class Record:
    """When a sample is stored: after so long, or when voltage or current has changed by so much."""

    time_s: float | None = None
    voltage_V: float | None = None
    current_A: float | None = None


@dataclass(frozen=True, slots=True)
class Soak:
    """When a soak is over.

    Attributes
    ----------
    within_K : float
        How near to the temperature the cell must be,
    hold_s : float
        for how long, with the chamber's air within the chamber's tolerance.
    limit_s : float
        Longest wait for that.
    goes_on : bool
        Whether the protocol then goes on as it is, in place of being stopped.
    """

    temperature_degC: float
    within_K: float
    hold_s: float
    limit_s: float
    goes_on: bool


@dataclass(frozen=True, slots=True)
class Step:
    """One step as it is written; what does not belong to its kind is None.

    Attributes
    ----------
    level : (str, float) or None
        ``current_A``, ``rate_C``, ``power_W`` or ``resistance_Ohm``, and its value; positive charges.
    limits : dict
        Windows that end the run when they are left.
    points : (times, unit, values) or None
        Of a profile.
    temperature_degC : float or None
        Set point of the chamber.
    """

    kind: str
    where: Where
    name: str | None = None
    label: str | None = None
    level: tuple[str, float] | None = None
    voltage_V: float | None = None
    until: tuple[Bound, ...] = ()
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    record: Record | None = None
    points: tuple[tuple[float, ...], str, tuple[float, ...]] | None = None
    clip_voltage_V: tuple[float, float] | None = None
    on_s: float | None = None
    off_s: float | None = None
    count: int = 1
    counts_cycles: bool | None = None
    steps: tuple[Step, ...] = ()
    to: str | None = None
    condition: Bound | None = None
    design: Mapping[str, Any] | None = None
    temperature_degC: float | None = None
    soak: Soak | None = None


@dataclass(frozen=True, slots=True)
class Protocol:
    """A protocol.

    Attributes
    ----------
    capacity_Ah : float or None
        Behind C-rates; None: that of the bench.
    limits : dict
        As a run takes them; they only narrow the bench's.
    document : dict
        What all of this was read from.
    """

    name: str
    capacity_Ah: float | None
    record: Record
    limits: Mapping[str, Any]
    steps: tuple[Step, ...]
    document: Mapping[str, Any]
