"""Which currents and states of charge leave a way to the end of an experiment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.design.constraints.limits import CurrentBounds, InfeasibleError, Limits

# Kept free inside each window, relative to its width, so that rounding never reaches its edge.
_MARGIN = 1e-9


def reachable_bounds(limits: Limits, bounds: CurrentBounds, dt_s: float) -> CurrentBounds:
    """Bounds within the cell's limits, eased where they step faster than the ramp may follow, from rest and to rest.

    Raises
    ------
    InfeasibleError
        The bounds leave no current at some sample.
    """
    low_A, high_A = limits.current_A
    low, high = np.clip(bounds.low_A, low_A, high_A), np.clip(bounds.high_A, low_A, high_A)
    if (low > high).any():
        k = int(np.argmax(low > high))
        raise InfeasibleError(
            f"load cycle: at sample {k} its limits are {low[k]:g}..{high[k]:g} A, which leaves no current"
        )
    if limits.ramp_A_per_s is not None:
        fall, rise = -limits.ramp_A_per_s[0] * dt_s, limits.ramp_A_per_s[1] * dt_s
        high = _followable(high, rise, fall)
        low = -_followable(-low, fall, rise)
        n, k = len(low), np.arange(len(low))
        high = np.minimum(high, np.minimum((k + 1) * rise, (n - k) * fall))
        low = np.maximum(low, np.maximum(-(k + 1) * fall, -(n - k) * rise))
    return replace(bounds, low_A=low, high_A=high)


def _followable(high: FloatArray, rise_A: float, fall_A: float) -> FloatArray:
    """Ease an upper bound upwards so that a current at it can be followed by ramps."""
    out = high.copy()
    for k in range(1, len(out)):
        out[k] = max(out[k], out[k - 1] - fall_A)
    for k in range(len(out) - 2, -1, -1):
        out[k] = max(out[k], out[k + 1] - rise_A)
    return out


def corridor(
    limits: Limits, bounds: CurrentBounds, initial_soc: float, soc_per_A: float, efficiency: float, dt_s: float
) -> tuple[FloatArray, FloatArray]:
    """(N + 1,) lowest and highest state of charge from which window and net charge can still be kept.

    Parameters
    ----------
    limits, bounds : what holds; ramps are left out here
    initial_soc : where the cell stands
    soc_per_A, efficiency : how the current is counted, per sample

    Raises
    ------
    InfeasibleError
        The cell stands outside, or no current keeps window and net charge; the message names them.
    """
    n, (bottom, top) = len(bounds.low_A), limits.soc
    if not bottom <= initial_soc <= top:
        raise InfeasibleError(
            f"limit soc is {bottom:g}..{top:g}, but the cell stands at {initial_soc:g}: charge or discharge it first, "
            "or widen the window"
        )
    low = min(bottom + _MARGIN * (top - bottom), initial_soc)
    high = max(top - _MARGIN * (top - bottom), initial_soc)
    soc_low, soc_high = np.full(n + 1, low), np.full(n + 1, high)
    if limits.net_charge_Ah is not None:
        per_Ah = 3600.0 / dt_s * soc_per_A
        soc_low[n] = max(low, initial_soc + limits.net_charge_Ah[0] * per_Ah)
        soc_high[n] = min(high, initial_soc + limits.net_charge_Ah[1] * per_Ah)
    most = np.where(bounds.high_A > 0.0, efficiency, 1.0) * bounds.high_A * soc_per_A
    least = np.where(bounds.low_A > 0.0, efficiency, 1.0) * bounds.low_A * soc_per_A
    for k in range(n - 1, -1, -1):
        soc_low[k] = max(soc_low[k], soc_low[k + 1] - most[k])
        soc_high[k] = min(soc_high[k], soc_high[k + 1] - least[k])
    rounding = 1e-12
    if (soc_low > soc_high + rounding).any() or not soc_low[0] - rounding <= initial_soc <= soc_high[0] + rounding:
        raise InfeasibleError(_conflict(limits, initial_soc, n))
    return soc_low, soc_high


def _conflict(limits: Limits, initial_soc: float, n_samples: int) -> str:
    what = "net_charge_Ah" if limits.net_charge_Ah is not None else "load cycle"
    ramp = "" if limits.ramp_A_per_s is None else " that ramp_A_per_s can follow"
    return (
        f"limits soc {limits.soc[0]:g}..{limits.soc[1]:g} and {what} are in conflict: from SoC {initial_soc:g} no "
        f"current within {limits.current_A[0]:g}..{limits.current_A[1]:g} A{ramp} keeps both over {n_samples} samples. "
        "Widen one of them, or start elsewhere"
    )
