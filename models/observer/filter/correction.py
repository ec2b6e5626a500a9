"""One hypothesis corrected by the measured voltage, and kept between empty and full.

Called by `compiled.step` only.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.observer.filter.places import (
    AT_CAPACITY,
    AT_LOOP,
    AT_OFFSET,
    AT_QUICK,
    AT_RESISTANCE,
    AT_SLOW,
    AT_VOLTAGE,
    COMPILED,
    GAIN_ROW,
    INNOVATION_OUT,
    INNOVATION_STD_OUT,
    OUTPUT_ROW,
    R_VOLTAGE,
    SOC_SLACK,
    STEADY,
    VOLTAGE_OUT,
)

# The steady-state gains take over once the SoC's variance is within this factor of theirs.
_START_UP_RATIO = 1.5


# Arguments one by one, as its caller has them: each access to an array in a tuple counts a reference.
@njit(**COMPILED)
def correct(
    n: int,
    constants: np.ndarray,
    x: np.ndarray,
    covariance: np.ndarray,
    scratch: np.ndarray,
    quick: float,
    slow: float,
    more: float,
    times: float,
    voltage: float,
    started: bool,
    blind: float,
    out: np.ndarray,
) -> None:
    """Correct one hypothesis by the measured voltage, if there is one.

    `n` past outputs stand first in the state. `quick`, `slow` and `more` are what one standard deviation of quick
    error, slow error and resistance error does to the output, `times` how far off the model is here beside where it was
    trained, `blind` the variance of the output by a current that is or was missing, 0 where none is. Expected voltage,
    innovation and the innovation's variance (all normalised) go to `out`.
    """
    size = x.shape[0]
    gain, seen = scratch[GAIN_ROW], scratch[OUTPUT_ROW]
    at_quick, at_slow, at_voltage, at_more = n + AT_QUICK, n + AT_SLOW, n + AT_VOLTAGE, n + AT_RESISTANCE
    for a in range(size):
        seen[a] = covariance[0, a] + covariance[at_voltage, a] + quick * covariance[at_quick, a]
        seen[a] += slow * covariance[at_slow, a] + more * covariance[at_more, a]
    variance = seen[0] + seen[at_voltage] + quick * seen[at_quick] + slow * seen[at_slow] + more * seen[at_more]
    # What tuning takes for noise is mostly the model's error.
    variance += times * times * constants[R_VOLTAGE]
    expected = x[0] + x[at_voltage] + quick * x[at_quick] + slow * x[at_slow] + more * x[at_more]
    innovation = voltage - expected
    out[VOLTAGE_OUT], out[INNOVATION_OUT], out[INNOVATION_STD_OUT] = expected, innovation, variance + blind
    if not np.isnan(voltage) and not started:
        if blind > 0.0:
            _update_blind(n, x, covariance, gain, seen, variance, innovation, blind)
        elif constants[STEADY] == 0.0 or covariance[n, n] > _START_UP_RATIO * gain[size]:
            # Far less is known than in the steady state that the gains were designed for: the same filter's gain for
            # what is known now, until the two meet.
            _update_best(x, covariance, seen, variance, innovation)
        else:
            _update(x, covariance, gain, seen, variance, innovation)
    _hold_within(x, covariance, n)


@njit(**COMPILED)
def _update_best(x: np.ndarray, covariance: np.ndarray, seen: np.ndarray, variance: float, innovation: float) -> None:
    """Move the state by the gain s / v, which leaves the covariance P - s s' / v."""
    size, per_root = x.shape[0], 1.0 / np.sqrt(variance)
    step = innovation * per_root
    for a in range(size):
        seen[a] *= per_root
        x[a] += seen[a] * step
    for a in range(size):
        for b in range(size):
            covariance[a, b] -= seen[a] * seen[b]


@njit(**COMPILED)
def _update(
    x: np.ndarray, covariance: np.ndarray, gain: np.ndarray, seen: np.ndarray, variance: float, innovation: float
) -> None:
    """Move the state by a gain.

    P - g s' - s g' + v g g' holds for any gain g, not only for the optimal one s / v (Joseph's form, multiplied out).
    With u = s / sqrt(v) and d = sqrt(v) g - u it is P - u u' + d d', which rounding leaves symmetric.
    """
    size, root = x.shape[0], np.sqrt(variance)
    for a in range(size):
        x[a] += gain[a] * innovation
        seen[a] /= root
        gain[a] = root * gain[a] - seen[a]
    for a in range(size):
        for b in range(size):
            covariance[a, b] += gain[a] * gain[b] - seen[a] * seen[b]


@njit(**COMPILED)
def _update_blind(
    n: int,
    x: np.ndarray,
    covariance: np.ndarray,
    gain: np.ndarray,
    seen: np.ndarray,
    variance: float,
    innovation: float,
    blind: float,
) -> None:
    """Move the state by a voltage under a current that nobody knows.

    What the current makes of the voltage is alike in many samples, so that they do not tell more than one. Nothing is
    taken from a voltage that is less sure than what is known, and no more than one such voltage tells: covariance
    intersection of the two, whose errors may be the same (Julier and Uhlmann, American Control Conference 1997).
    Sensors, capacity and resistances are not told by it (Schmidt, Advances in Control Systems 3, 1966).
    """
    if variance <= blind:
        return
    total = variance * variance / (variance - blind)
    for a in range(x.shape[0]):
        gain[a] = seen[a] / total
    for place in (AT_OFFSET, AT_CAPACITY, AT_VOLTAGE, AT_RESISTANCE):
        gain[n + place] = 0.0
    _update(x, covariance, gain, seen, total, innovation)


@njit(**COMPILED)
def _hold_within(x: np.ndarray, covariance: np.ndarray, n: int) -> None:
    """Project the state where its SoC is more than full or less than empty (Simon, IET Control Theory 4, 2010, eq. 26).

    What the voltage says beyond that is the model's error then, and moves by what it has in common with the SoC. The
    sensors are not blamed.
    """
    beyond = x[n] - min(max(x[n], -SOC_SLACK), 1.0 + SOC_SLACK)
    if beyond == 0.0:
        return
    if covariance[n, n] > 0.0:
        for place in (AT_QUICK, AT_SLOW, AT_VOLTAGE, AT_RESISTANCE, AT_LOOP):
            if n + place < x.shape[0]:
                x[n + place] -= covariance[n, n + place] / covariance[n, n] * beyond
    x[n] -= beyond
