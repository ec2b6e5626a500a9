"""A voltage outside of what a model of the cell expects of the profile: said at once, ended where it lasts.

The band is computed before the run, for the profile as planned; it may be long, so it is looked up, never stepped.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from bench_service.bench.plausibility.finding import Finding


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedVoltage:
    """What a model expects.

    Parameters
    ----------
    dt_s : float
        Step of the grid, which begins with the profile.
    lower_V, upper_V : sequence of float, length n
        The model's band.
    margin_V : float
        How far beyond the band the voltage may be.
    for_s : float
        How long it may be farther than that.
    """

    dt_s: float
    lower_V: Sequence[float]
    upper_V: Sequence[float]
    margin_V: float
    for_s: float

    def beyond_V(self, position_s: float, voltage_V: float) -> float:
        """Return how far outside the band a voltage is; 0 inside. A step may come a grid point early or late."""
        at = min(len(self.lower_V) - 1, max(0, round(position_s / self.dt_s)))
        near = slice(max(0, at - 1), at + 2)
        return max(0.0, min(self.lower_V[near]) - voltage_V, voltage_V - max(self.upper_V[near]))


def follow(since_s: float, expected: ExpectedVoltage, position_s: float, voltage_V: float) -> float:
    """Return since when, along the profile, the voltage has been outside; NaN where it is not."""
    if not expected.beyond_V(position_s, voltage_V) > expected.margin_V:
        return math.nan
    return position_s if math.isnan(since_s) else since_s


def judge(since_s: float, expected: ExpectedVoltage, position_s: float, voltage_V: float) -> Finding | None:
    """Return what is to be said."""
    if math.isnan(since_s):
        return None
    lasts_s = position_s - since_s
    text = (
        f"voltage {voltage_V:.4f} V has been over {1e3 * expected.margin_V:.3g} mV outside of the model's band for "
        f"{lasts_s:.3g} s, now by {1e3 * expected.beyond_V(position_s, voltage_V):.3g} mV; "
        f"allowed are {expected.for_s:g} s"
    )
    remedy = "check cell, sense leads and the state of charge that the run was started with"
    return Finding("trip" if lasts_s >= expected.for_s else "warn", "model_band", text, remedy)
