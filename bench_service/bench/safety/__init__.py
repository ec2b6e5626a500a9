"""Safety rules of a run: what ends it at once. Pure functions of a reading and its context."""

from bench_service.bench.safety.checks import check, check_age, check_at_rest, check_held
from bench_service.bench.safety.rules import SOC_TOLERANCE, Rules
from bench_service.bench.safety.track import Track, follow
from bench_service.bench.safety.trip import Code, Context, Trip, TripError, implausible, second_master

__all__ = [
    "SOC_TOLERANCE",
    "Code",
    "Context",
    "Rules",
    "Track",
    "Trip",
    "TripError",
    "check",
    "check_age",
    "check_at_rest",
    "check_held",
    "follow",
    "implausible",
    "second_master",
]
