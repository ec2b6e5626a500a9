"""Filters that signals are made with, over whole runs and starting at rest: low-pass, relaxation, diffusion."""

from __future__ import annotations

import numpy as np
from numba import njit

from models.data.timeseries import FloatArray

# Time constants of the three stages of the relaxation filter over the slowest of them: the slowest is the relaxation
# itself, the others only round off the step's edge.
_RELAXATION_STAGES = (1.0, 0.002, 0.002)
# Over so much of the state of charge a diffusion that slows down towards empty does so by a factor of e.
EMPTY_SOC = 0.12
# Further than this no mean is said to be behind a surface: so far beyond its data a curve goes on.
FURTHEST_BEHIND = 0.5
# Time constant of the slow state that a model's domain is told by.
_SLOW_S = 600.0


def relaxation_poles(time_constant_s: float, dt_s: float) -> FloatArray:
    """(3,) poles of the relaxation filter's stages at sampling time `dt_s`."""
    return np.exp(-dt_s / (time_constant_s * np.array(_RELAXATION_STAGES)))


def relaxation(current_A: FloatArray, time_constant_s: float, dt_s: float) -> FloatArray:
    """Third-order low-pass of the current's change: zero at rest and at constant current, non-zero in between.

    After a step of the current it rises to the step's height and dies out with `time_constant_s`. It is scaled by
    time_constant_s / dt_s, which makes it independent of the sampling time.

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
    2014. Three equal stages would rise only after about the time constant itself, which no pulse test shows: with them
    a simulated cell was fitted to 5 mV, with quick second and third stages to 2.5 mV.
    """
    change = np.diff(current_A, prepend=current_A[:1])
    poles = relaxation_poles(time_constant_s, dt_s)
    for pole in poles:
        change = smoothed(change, pole)
    return change / (1.0 - poles[0])


def low_pass(values: FloatArray, time_constant_s: float, dt_s: float) -> FloatArray:
    """First-order low-pass with unit gain, starting at rest: of a current, one RC pair's current in A."""
    pole = float(np.exp(-dt_s / time_constant_s))
    return smoothed(values, pole)


def slow_current_A(current_A: FloatArray, dt_s: float) -> FloatArray:
    """(n,) current of the last ten minutes or so: where a model is used at a slow state that it was never shown."""
    return low_pass(current_A, _SLOW_S, dt_s)


def smoothed(values: FloatArray, pole: float) -> FloatArray:
    """First-order low-pass of unit gain by its pole.

    To the bit what SciPy's `lfilter` gives; its package alone takes 0.4 s of processor time at every start.
    """
    return _low_passed(np.ascontiguousarray(values, dtype=np.float64), float(pole))


@njit(cache=True)
def _low_passed(values: np.ndarray, pole: float) -> np.ndarray:
    out, state = np.empty(values.shape[0]), 0.0
    for k in range(values.shape[0]):
        state = pole * state + (1.0 - pole) * values[k]
        out[k] = state
    return out


# Roots of tan(x) = x: the modes in which concentration evens out in a sphere, slowest first. Of their infinite number
# three hold 84 % of the settled difference; the rest is quicker than a sample of 1 s and acts as a resistance.
_DIFFUSION_ROOTS = np.array([4.493409458, 7.725251837, 10.904121659])
DIFFUSION_GAINS = _DIFFUSION_ROOTS**-2.0 / float(np.sum(_DIFFUSION_ROOTS**-2.0))


def diffusion_rates(time_constant_s: float, dt_s: float) -> FloatArray:
    """(3,) samples' length over the time constants of the diffusion modes at 25 degC."""
    return dt_s / time_constant_s * (_DIFFUSION_ROOTS / _DIFFUSION_ROOTS[0]) ** 2


def diffusion(values: FloatArray, time_constant_s: float, slowed: FloatArray, dt_s: float) -> FloatArray:
    """Low-pass of unit gain with the modes of diffusion in a sphere, starting at rest.

    Parameters
    ----------
    values : (n,) what flows in
    time_constant_s : of the slowest mode at 25 degC
    slowed : (n,) or (1,) factor by which the time constants are longer at each sample's temperature
    dt_s : sampling time in s

    Returns
    -------
    (n,) difference between surface and mean, in the values' unit

    Notes
    -----
    Crank, "The Mathematics of Diffusion", 1975, eq. 6.45: the modes' settled shares go with the inverse squared roots,
    their time constants too. A slower diffusion has a larger settled difference and a longer way to it, both alike.
    """
    rates = diffusion_rates(time_constant_s, dt_s)
    return _diffusion(values, rates, DIFFUSION_GAINS, np.broadcast_to(slowed, values.shape))


@njit(cache=True)
def slower_at(emptying: float, soc: float) -> float:
    """By how much diffusion is slower at a state of charge than far from empty.

    Parameters
    ----------
    emptying : how many times its time more it takes at empty
    soc : fraction
    """
    return float(1.0 + emptying * np.exp(-max(soc, 0.0) / EMPTY_SOC))


def slower_when_empty(emptying: float, soc: FloatArray) -> FloatArray:
    """(n,) the same over many states of charge; NaN stays."""
    return 1.0 + emptying * np.exp(-np.maximum(soc, 0.0) / EMPTY_SOC)


@njit(cache=True)
def _diffusion(values: np.ndarray, rates: np.ndarray, gains: np.ndarray, slowed: np.ndarray) -> np.ndarray:
    out = np.empty(values.shape[0])
    modes = np.zeros(rates.shape[0])
    for k in range(values.shape[0]):
        total = 0.0
        for i in range(rates.shape[0]):
            keep = np.exp(-rates[i] / slowed[k])
            modes[i] = keep * modes[i] + (1.0 - keep) * gains[i] * values[k]
            total += modes[i]
        out[k] = total
    return out
