"""Clocks that are put forward or back by an hour while they log."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray

_HOUR_S = 3600.0
# After the hour is taken off, what is left is an interval of the log: at most so many of its typical ones.
_INTERVALS = 5.0
# The voltage goes on as if nothing had happened: its step is at most so many of those around it.
_STEPS = 5.0
_AROUND = 20
# A load is more than this share of the largest current, and the same on both sides to this share.
_LOADED, _ALIKE = 0.05, 0.05


def without_hour_jumps(
    time_s: FloatArray, current_A: FloatArray, voltage_V: FloatArray
) -> tuple[FloatArray, list[int]]:
    """Take jumps of an hour out of a log's time.

    A jump back is one of the clock. A jump forward is one where a load goes on through it and the voltage with it; an
    hour's pause at rest changes nothing, and is left.

    Parameters
    ----------
    time_s, current_A, voltage_V : (n,) as logged

    Returns
    -------
    time_s, jumps
        (n,) without them, and the samples after each jump.
    """
    step = np.diff(time_s)
    usual = float(np.median(step[step > 0.0])) if (step > 0.0).any() else 0.0
    back, forward = step + _HOUR_S, step - _HOUR_S
    jumps = []
    correction = np.zeros(len(step))
    for k in np.flatnonzero((step < 0.0) & (back > 0.0) & (back <= _INTERVALS * usual)):
        correction[k] = _HOUR_S
        jumps.append(int(k) + 1)
    for k in np.flatnonzero((forward > 0.0) & (forward <= _INTERVALS * usual)):
        if _goes_on(current_A, voltage_V, int(k)):
            correction[k] = -_HOUR_S
            jumps.append(int(k) + 1)
    if not jumps:
        return time_s, []
    return time_s + np.concatenate([[0.0], np.cumsum(correction)]), sorted(jumps)


def _goes_on(current_A: FloatArray, voltage_V: FloatArray, k: int) -> bool:
    """Whether load and voltage go on from sample `k` to the next as they did before and do after."""
    largest = float(np.nanmax(np.abs(current_A)))
    here, there = current_A[k], current_A[k + 1]
    if not (abs(here) > _LOADED * largest and abs(there - here) <= _ALIKE * largest):
        return False
    around = np.abs(np.diff(voltage_V[max(k - _AROUND, 0) : k + 2 + _AROUND]))
    usual = float(np.nanmedian(around)) if np.isfinite(around).any() else 0.0
    return bool(abs(voltage_V[k + 1] - voltage_V[k]) <= _STEPS * max(usual, 1e-4))
