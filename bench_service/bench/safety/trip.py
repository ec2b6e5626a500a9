"""A violated rule, and what a reading is judged against."""

from dataclasses import dataclass
from typing import Literal

from bench_service.bench.plausibility.finding import Finding, PlausibilityCode
from bench_service.bench.safety.rules import Rules
from bench_service.bench.safety.track import Track

Code = Literal[
    "voltage_limit",
    "current_limit",
    "temperature_limit",
    "soc_limit",
    "ramp_limit",
    "duration_limit",
    "reading_too_old",
    "stale_readings",
    "device_alarm",
    "output_off",
    "current_mismatch",
    "voltage_stuck",
    "temperature_jump",
    "second_master",
    "remote_lost",
    "output_on",
    "chamber_fault",
    "chamber_lost",
    "chamber_limit",
    "chamber_changed",
    PlausibilityCode,
]


@dataclass(frozen=True, slots=True)
class Trip:
    """A violated rule.

    Parameters
    ----------
    code : str
    text : str
        What, where, the value with its unit, the limit, what to do.
    """

    code: Code
    text: str


class TripError(Exception):
    """A safety rule was violated."""

    def __init__(self, trip: Trip) -> None:
        super().__init__(trip.text)
        self.code = trip.code


@dataclass(frozen=True, slots=True)
class Context:
    """What a reading is judged against.

    Parameters
    ----------
    rules : Rules
    track : Track
        Including this reading.
    now_s : float
        Time since the run's start.
    soc : float or None
        From counting charge; None where the initial one is unknown.
    commanded_A : float
        Set-point in force before this sample.
    held_s : float
        For how long the run has been held so far: no part of its duration.
    """

    rules: Rules
    track: Track
    now_s: float
    soc: float | None
    commanded_A: float
    held_s: float = 0.0


def outside(context: Context, code: Code, what: str, value: float, unit: str, window: tuple[float, float]) -> Trip:
    """Return the trip of a value that is missing or outside its window."""
    suffix = f" {unit}" if unit else ""
    shown = "is missing" if value != value else f"{value:.5g}{suffix} is outside"
    return trip(
        context,
        code,
        f"{what} {shown}, limits {window[0]:g} to {window[1]:g}{suffix}",
        "check cell, sensor and limits, acknowledge",
    )


def trip(context: Context, code: Code, what: str, remedy: str) -> Trip:
    """Return a trip with its full sentence."""
    return Trip(code, f"{context.rules.bench} at {context.now_s:.3f} s: {what}; output switched off, {remedy}")


def implausible(context: Context, finding: Finding) -> Trip:
    """Return the trip of a finding."""
    return trip(context, finding.code, finding.text, f"{finding.remedy}, acknowledge")


def second_master(context: Context, difference: str) -> Trip:
    """Return the trip of settings that somebody else has changed in the device."""
    return trip(context, "second_master", difference, "find the other program, acknowledge")
