"""Which way the current last flowed: a sign held through rests, and a state that follows with the charge."""

from __future__ import annotations

import numpy as np
from numba import njit

from models.data.timeseries import FloatArray

# Below this share of 1C a current counts as rest: sensors read a few mA at rest, which is no change of direction.
REST_C_RATE = 0.005


def held_sign(current_A: FloatArray, rest_A: float, initial: float = -1.0) -> FloatArray:
    """Direction of the last current: +1 after charge, -1 after discharge, held through rests.

    Parameters
    ----------
    current_A : (n,)
    rest_A : magnitudes up to this count as rest
    initial : value before the first current; a cell that was charged and then rested is about to be discharged

    Notes
    -----
    The hysteresis input z_Hyst of the method (ch. 2.2.3.1).
    """
    sign = np.where(current_A > rest_A, 1.0, np.where(current_A < -rest_A, -1.0, 0.0))
    index = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), -1))
    return np.where(index >= 0, sign[np.maximum(index, 0)], initial)


def hysteresis_state(current_A: FloatArray, rate: float, dt_s: float, capacity_Ah: float) -> FloatArray:
    """One-state hysteresis between -1 and 1: it follows the current's direction with the charge that flows.

    h(k) = e h(k-1) + (1 - e) sign(I(k)) with e = exp(-rate |I(k)| dt / Q), starting at 0.

    Notes
    -----
    Plett, "Battery Management Systems I", 2015, ch. 2.
    """
    keep = np.exp(-rate * np.abs(current_A) * dt_s / (3600.0 * capacity_Ah))
    return _first_order(keep, (1.0 - keep) * np.sign(current_A))


@njit(cache=True)
def _first_order(keep: np.ndarray, drive: np.ndarray) -> np.ndarray:
    out = np.empty(keep.shape[0])
    state = 0.0
    for k in range(keep.shape[0]):
        state = keep[k] * state + drive[k]
        out[k] = state
    return out
