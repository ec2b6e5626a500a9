"""Signals derived from what a bench measures: state of charge, hysteresis, relaxation.

Each comes in two forms that agree: over a whole run (arrays) and sample by sample (state in, state out).
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from models.timeseries import FloatArray

# Below this share of 1C a current counts as rest: sensors read a few mA at rest, which is no change of direction.
REST_C_RATE = 0.005


def soc_by_counting(
    charge_Ah: FloatArray, initial_soc: float, capacity_Ah: float, efficiency: float = 1.0
) -> FloatArray:
    """State of charge from counted charge.

    Parameters
    ----------
    charge_Ah : (n,) charge counted from the start, positive: charged
    initial_soc : fraction 0..1
    capacity_Ah : cell capacity in Ah
    efficiency : coulombic efficiency that applies to charging

    Returns
    -------
    (n,) fraction

    Notes
    -----
    Unger, Kozek, Jakubek, "Energy Efficient Non-Road Hybrid Electric Vehicles", ch. 2, eq. 2.32 and 2.33.
    """
    if efficiency == 1.0:
        return initial_soc + charge_Ah / capacity_Ah
    step = np.diff(charge_Ah, prepend=charge_Ah[0])
    return initial_soc + np.cumsum(np.where(step > 0, efficiency * step, step)) / capacity_Ah


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


# Time constants of the three stages of the relaxation filter over the slowest of them: the slowest is the relaxation
# itself, the others round off the step's edge.
_RELAXATION_STAGES = (1.0, 0.002, 0.002)


def relaxation_poles(time_constant_s: float, dt_s: float) -> FloatArray:
    """(3,) poles of the relaxation filter's stages at sampling time `dt_s`."""
    return np.exp(-dt_s / (time_constant_s * np.array(_RELAXATION_STAGES)))


def relaxation(current_A: FloatArray, time_constant_s: float, dt_s: float) -> FloatArray:
    """Third-order low-pass of the current's change: zero at rest and at constant current, non-zero in between.

    After a step of the current it rises to about the step's height and dies out with `time_constant_s`. It is scaled
    by time_constant_s / dt_s, which makes it independent of the sampling time.

    Parameters
    ----------
    current_A : (n,) in A
    time_constant_s : in s
    dt_s : sampling time in s

    Returns
    -------
    (n,) in A

    Notes
    -----
    Eq. 2.7 of the method; third order and time constant from the voltage's return after pulses, after Unger et al.
    2014. Three equal stages would have a return like t^2 exp(-3 t / tau), which no pulse test shows.
    """
    change = np.diff(current_A, prepend=current_A[:1])
    poles = relaxation_poles(time_constant_s, dt_s)
    for pole in poles:
        change = lfilter([1.0 - pole], [1.0, -pole], change)
    return np.asarray(change, dtype=np.float64) / (1.0 - poles[0])


def low_pass(current_A: FloatArray, time_constant_s: float, dt_s: float) -> FloatArray:
    """First-order low-pass of the current with unit gain, starting at rest: one RC pair's current in A."""
    pole = float(np.exp(-dt_s / time_constant_s))
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], current_A), dtype=np.float64)
