"""Several states of charge held possible at once: weighed by the measurement, dropped, merged, summed up.

Called by `compiled.step` only.
Those that are still possible stand first, and a weight of 0 ends them.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.observer.filter.places import (
    AT_CAPACITY,
    AT_OFFSET,
    AT_RESISTANCE,
    AT_SLOW,
    CAPACITY_OUT,
    CAPACITY_STD_OUT,
    COMPILED,
    ERROR_OUT,
    EXPECTED_ROW,
    HYPOTHESES_OUT,
    INNOVATION_OUT,
    INNOVATION_ROW,
    INNOVATION_STD_OUT,
    LIKELIHOOD_ROW,
    OFFSET_OUT,
    OFFSET_STD_OUT,
    SOC_OUT,
    SOC_STD_OUT,
    VOLTAGE_OUT,
)

# A hypothesis less likely than this is dropped; two are merged where they are closer than this share of the smaller
# variance, as long as the result is narrower than this standard deviation.
_LEAST_WEIGHT = 1e-5
# The model's error is never quite as assumed; a likelihood raised to this power keeps hypotheses for longer.
_TRUST = 0.5
_MERGE_SHARE = 0.6
_WIDEST_STD = 0.02


@njit(**COMPILED)
def count(weight: np.ndarray) -> int:
    """How many hypotheses there are."""
    alive = 0
    while alive < weight.shape[0] and weight[alive] > 0.0:
        alive += 1
    return alive


@njit(**COMPILED)
def weigh(
    n: int,
    x: np.ndarray,
    covariance: np.ndarray,
    weight: np.ndarray,
    scratch: np.ndarray,
    alive: int,
    voltage: float,
    out: np.ndarray,
) -> int:
    """Weigh the hypotheses by what was measured, drop and merge them; return how many are left.

    `n` past outputs stand first in their states.

    Expected voltage, innovation and its variance of all together go to `out`, normalised.
    """
    variances, expected, innovation = scratch[LIKELIHOOD_ROW], scratch[EXPECTED_ROW], scratch[INNOVATION_ROW]
    if alive == 1:
        out[VOLTAGE_OUT], out[INNOVATION_OUT], out[INNOVATION_STD_OUT] = expected[0], innovation[0], variances[0]
        return 1
    mean, off, square = 0.0, 0.0, 0.0
    for j in range(alive):
        mean += weight[j] * expected[j]
        off += weight[j] * innovation[j]
        square += weight[j] * (variances[j] + expected[j] ** 2)
    out[VOLTAGE_OUT], out[INNOVATION_OUT], out[INNOVATION_STD_OUT] = mean, off, square - mean**2
    if not np.isnan(voltage):
        best = -np.inf
        for j in range(alive):
            fit = innovation[j] ** 2 / variances[j] + np.log(variances[j])
            variances[j] = np.log(weight[j]) - 0.5 * _TRUST * fit
            best = max(best, variances[j])
        for j in range(alive):
            weight[j] = np.exp(variances[j] - best)
    return _thin_out(n, x, covariance, weight, alive)


@njit(**COMPILED)
def sum_up(n: int, x: np.ndarray, covariance: np.ndarray, weight: np.ndarray, alive: int, out: np.ndarray) -> None:
    """Write mean and variance of SoC, current offset and capacity error over all hypotheses."""
    out[HYPOTHESES_OUT], out[ERROR_OUT] = alive, 0.0
    for j in range(alive):
        out[ERROR_OUT] += weight[j] * max(abs(x[j, n + AT_SLOW]), abs(x[j, n + AT_RESISTANCE]))
    for place, at, at_variance in (
        (n, SOC_OUT, SOC_STD_OUT),
        (n + AT_OFFSET, OFFSET_OUT, OFFSET_STD_OUT),
        (n + AT_CAPACITY, CAPACITY_OUT, CAPACITY_STD_OUT),
    ):
        mean, square = 0.0, 0.0
        for j in range(alive):
            mean += weight[j] * x[j, place]
        for j in range(alive):
            square += weight[j] * (covariance[j, place, place] + (x[j, place] - mean) ** 2)
        out[at], out[at_variance] = mean, square


@njit(**COMPILED)
def _thin_out(n: int, x: np.ndarray, covariance: np.ndarray, weight: np.ndarray, alive: int) -> int:
    """Drop unlikely hypotheses, merge those that have met, and make the weights add up to 1."""
    _normalise(weight, alive)
    for j in range(alive):
        if weight[j] < _LEAST_WEIGHT:
            weight[j] = 0.0
    for i in range(alive):
        for j in range(i + 1, alive):
            if weight[i] == 0.0 or weight[j] == 0.0:
                continue
            apart = (x[i, n] - x[j, n]) ** 2
            least = min(covariance[i, n, n], covariance[j, n, n])
            share = weight[i] / (weight[i] + weight[j])
            merged = share * covariance[i, n, n] + (1.0 - share) * covariance[j, n, n] + share * (1.0 - share) * apart
            if apart <= _MERGE_SHARE * least and merged <= _WIDEST_STD**2:
                _merge(x, covariance, i, j, share)
                weight[i] += weight[j]
                weight[j] = 0.0
    left = 0
    for j in range(alive):
        if weight[j] > 0.0:
            if j != left:
                _copy(x, covariance, j, left)
                weight[left], weight[j] = weight[j], 0.0
            left += 1
    _normalise(weight, left)
    return left


@njit(**COMPILED)
def _copy(x: np.ndarray, covariance: np.ndarray, source: int, target: int) -> None:
    """Put a hypothesis in another place."""
    size = x.shape[1]
    for a in range(size):
        x[target, a] = x[source, a]
        for b in range(size):
            covariance[target, a, b] = covariance[source, a, b]


@njit(**COMPILED)
def _merge(x: np.ndarray, covariance: np.ndarray, i: int, j: int, share: float) -> None:
    """Put two hypotheses into the first, mean and covariance kept."""
    size = x.shape[1]
    for a in range(size):
        for b in range(size):
            between = (x[i, a] - x[j, a]) * (x[i, b] - x[j, b])
            covariance[i, a, b] = share * covariance[i, a, b] + (1.0 - share) * covariance[j, a, b]
            covariance[i, a, b] += share * (1.0 - share) * between
    for a in range(size):
        x[i, a] = share * x[i, a] + (1.0 - share) * x[j, a]


@njit(**COMPILED)
def _normalise(weight: np.ndarray, alive: int) -> None:
    total = 0.0
    for j in range(alive):
        total += weight[j]
    for j in range(alive):
        weight[j] /= total
