"""The value that an end or a condition looks at."""

from __future__ import annotations

from bench_service.protocol.laws import Seen
from bench_service.protocol.state import Standing


def value_of(quantity: str, seen: Seen, standing: Standing) -> float | None:
    """Return a quantity as a sample and the step's counters have it; None where nobody knows it."""
    if quantity == "voltage_V":
        return seen.voltage_V
    if quantity == "current_A":
        return abs(seen.current_A)
    if quantity == "charge_Ah":
        return abs(standing.step.net_Ah)
    if quantity == "soc":
        return seen.soc
    if quantity == "cycle":
        return float(standing.cycle_count)
    return seen.temperature_degC
