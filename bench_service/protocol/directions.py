"""On which side of its value an end is met where nobody says so."""

from __future__ import annotations

from bench_service.errors import Where
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.steps import Bound, Step

# What ends a step without a statement of the direction: the first sample at or beyond it.
_ALWAYS_ABOVE = ("time_s", "charge_Ah", "charge_share", "temperature_degC")
_ALWAYS_BELOW = ("current_A", "rate_C", "dV_dt_V_per_s")


def direction(bound: Bound, step: Step, level: float, where: Where) -> bool:
    """Return whether a bound without a direction is met above its value; raises `ProtocolError`."""
    if bound.quantity in _ALWAYS_ABOVE:
        return True
    if bound.quantity in _ALWAYS_BELOW:
        return False
    if step.kind == "resistance":
        return False  # a load only discharges
    if step.kind in ("constant_current", "cc_cv", "power", "pulse") and bound.quantity in ("voltage_V", "soc"):
        return level > 0
    if step.kind == "cc_cv" and bound.quantity == "soc":
        return level > 0
    raise ProtocolError("the direction is not clear", where, remedy='write {"above": x} or {"below": x}')
