"""Clocks that are put forward or back by an hour while they log."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray

_HOUR_S = 3600.0
# After the hour is taken off, what is left is an interval of the log: at most so many of its typical ones.
_INTERVALS = 5.0
# A longer one beside a jump back, or left by it, is a row in the wrong place, unless the log itself is so slow.
_LONG_S, _LONG_INTERVALS = 900.0, 1.5
# A clock is set back for winter, and perhaps once by hand; in a log of years once more in each.
_SET_BACK, _YEAR_S = 2, 365.25 * 86400.0
# The voltage goes on as if nothing had happened: its step is at most so many of those around it.
_STEPS = 5.0
_AROUND = 20
# A load is more than this share of the largest current, and the same on both sides to this share.
_LOADED, _ALIKE = 0.05, 0.05


def without_hour_jumps(
    time_s: FloatArray, current_A: FloatArray, voltage_V: FloatArray
) -> tuple[FloatArray, list[int]]:
    """Take jumps of an hour out of a log's time.

    Jumps back are those of the clock where all of them are an hour, few, and the log goes on as before: else its rows
    are out of order, and it is left. A jump forward is one where a load goes on through it and the voltage with it; an
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
    forward = step - _HOUR_S
    falls = np.flatnonzero(step < 0.0)
    few = len(falls) <= _SET_BACK + np.ptp(time_s) / _YEAR_S
    if not (few and all(_set_back(step, usual, int(k)) for k in falls)):
        return time_s, []
    correction = np.zeros(len(step))
    correction[falls] = _HOUR_S
    jumps = [int(k) + 1 for k in falls]
    for k in np.flatnonzero((forward > 0.0) & (forward <= _INTERVALS * usual)):
        if _goes_on(current_A, voltage_V, int(k)):
            correction[k] = -_HOUR_S
            jumps.append(int(k) + 1)
    if not jumps:
        return time_s, []
    return time_s + np.concatenate([[0.0], np.cumsum(correction)]), sorted(jumps)


def _set_back(step_s: FloatArray, usual_s: float, k: int) -> bool:
    """Whether the fall of the time after sample `k` is an hour of the clock, with the log's intervals around it."""
    left_s, long_s = step_s[k] + _HOUR_S, max(_LONG_S, _LONG_INTERVALS * usual_s)
    beside_s = step_s[max(k - 1, 0) : k + 2]
    return bool(0.0 < left_s <= min(_INTERVALS * usual_s, long_s) and (beside_s <= long_s).all())


def _goes_on(current_A: FloatArray, voltage_V: FloatArray, k: int) -> bool:
    """Whether load and voltage go on from sample `k` to the next as they did before and do after."""
    largest = float(np.nanmax(np.abs(current_A)))
    here, there = current_A[k], current_A[k + 1]
    if not (abs(here) > _LOADED * largest and abs(there - here) <= _ALIKE * largest):
        return False
    around = np.abs(np.diff(voltage_V[max(k - _AROUND, 0) : k + 2 + _AROUND]))
    usual = float(np.nanmedian(around)) if np.isfinite(around).any() else 0.0
    return bool(abs(voltage_V[k + 1] - voltage_V[k]) <= _STEPS * max(usual, 1e-4))
