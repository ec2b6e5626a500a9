"""One hypothesis moved to the next sample: validity functions, output and its derivatives, covariance.

Called by `compiled.step` only. The compiler caches per file: after a change here, delete `__pycache__/*.nb*`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.electrothermal_loop import FILTERED, RELAXATION, SOC, SQUARED, FlatNetwork
from models.observer.places import (
    AT_CAPACITY,
    AT_OFFSET,
    AT_QUICK,
    AT_RESISTANCE,
    AT_SLOW,
    BLENDED_ROW,
    GAIN_ROW,
    KEPT_ROW,
    MORE_A,
    MOVED_ROWS,
    OUTPUT_ROW,
    Q_OUTPUT,
    QUICK_KEEP,
    R_VOLTAGE,
    STEADY,
    TILT_ROW,
    TILTED_ROW,
    VALIDITY_ROW,
)

# A local model whose weight is below exp(-this) of the largest adds nothing that a double could hold.
_NEGLIGIBLE = 40.0


@njit(cache=True)
def predict(
    net: FlatNetwork,
    level: np.ndarray,
    gains: np.ndarray,
    constants: np.ndarray,
    x: np.ndarray,
    covariance: np.ndarray,
    history: np.ndarray,
    scratch: np.ndarray,
    base: float,
    moved: float,
    keep_slow: float,
    q_soc: float,
    first: bool,
    voltage: float,
) -> tuple[float, float]:
    """Move one hypothesis to this sample before its voltage is known.

    Returns the size of the model's error here, and what the current does to the output (normalised).
    """
    order, n = net.order, max(net.order, 1)
    _blend(net, history, scratch, base)
    y, overpotential = _output(net, constants, x, history, scratch, base)
    error_level = _weigh(level, gains, scratch, constants[STEADY] > 0.0)
    if first and order > 0:
        # No output before the first sample: start from the measurement.
        y = voltage if not np.isnan(voltage) else x[0]
        for lag in range(order):
            x[lag] = y
            covariance[lag, lag] = constants[R_VOLTAGE]
        return error_level, overpotential
    soc_per_A, row, kept = 0.0 if first else net.soc_per_A, scratch[OUTPUT_ROW], scratch[KEPT_ROW]
    for a in range(x.shape[0]):
        kept[a] = 1.0
    kept[n + AT_QUICK] = constants[QUICK_KEEP]
    kept[n + AT_SLOW] = kept[n + AT_RESISTANCE] = keep_slow
    _spread(covariance, scratch, n, soc_per_A, moved)
    covariance[0, 0] += constants[Q_OUTPUT]
    covariance[n, n] += q_soc
    for lag in range(n - 1, 0, -1):
        x[lag] = x[lag - 1]
    x[0] = y + row[n + AT_OFFSET] * x[n + AT_OFFSET]
    x[n] += moved * (1.0 + x[n + AT_CAPACITY]) - soc_per_A * x[n + AT_OFFSET]
    for a in (n + AT_QUICK, n + AT_SLOW, n + AT_RESISTANCE):
        covariance[a, a] += 1.0 - kept[a] ** 2
        x[a] *= kept[a]
    return error_level, overpotential


@njit(cache=True)
def _blend(net: FlatNetwork, history: np.ndarray, scratch: np.ndarray, base: float) -> None:
    """Validity functions at this hypothesis' state of charge, blended parameters, and the derivatives of both by it."""
    phi, tilt = scratch[VALIDITY_ROW], scratch[TILT_ROW]
    blended, tilted = scratch[BLENDED_ROW], scratch[TILTED_ROW]
    # Taken out of the tuple once: each access counts a reference.
    theta, centres, widths = net.theta, net.centres, net.widths
    axis_signal, axis_lag, kind, span = net.axis_signal, net.axis_lag, net.kind, net.span
    n_models, n_params = theta.shape
    for i in range(n_models):
        phi[i] = tilt[i] = 0.0
    for j in range(axis_signal.shape[0]):
        s = axis_signal[j]
        z, per_soc = history[0, axis_lag[j], s], 0.0
        if kind[s] == SOC:
            per_soc = 1.0 / span[s]
            z += base * per_soc
        for i in range(n_models):
            scaled = (z - centres[i, j]) / widths[i, j]
            phi[i] -= 0.5 * scaled * scaled
            tilt[i] -= per_soc * scaled / widths[i, j]
    largest = -np.inf
    for i in range(n_models):
        largest = max(largest, phi[i])
    total, mean_tilt = 0.0, 0.0
    for i in range(n_models):
        below = phi[i] - largest
        phi[i] = np.exp(below) if below > -_NEGLIGIBLE else 0.0
        total += phi[i]
    for i in range(n_models):
        phi[i] /= total
        mean_tilt += phi[i] * tilt[i]
    for p in range(n_params):
        blended[p] = tilted[p] = 0.0
    for i in range(n_models):
        if phi[i] > 0.0:
            share, turned = phi[i], phi[i] * (tilt[i] - mean_tilt)
            for p in range(n_params):
                blended[p] += share * theta[i, p]
                tilted[p] += turned * theta[i, p]


@njit(cache=True)
def _output(
    net: FlatNetwork,
    constants: np.ndarray,
    x: np.ndarray,
    history: np.ndarray,
    scratch: np.ndarray,
    base: float,
) -> tuple[float, float]:
    """Output and what the current does to it, both normalised; the output's derivatives go to the scratch space.

    The validity functions move with the state of charge too, and on a plateau the local parameters without that part
    can even have the wrong sign.
    """
    row, blended, tilted = scratch[OUTPUT_ROW], scratch[BLENDED_ROW], scratch[TILTED_ROW]
    kind, low, span = net.kind, net.low, net.span
    tap_signal, tap_lag = net.tap_signal, net.tap_lag
    order, n, n_params = net.order, max(net.order, 1), net.theta.shape[1]
    for a in range(x.shape[0]):
        row[a] = 0.0
    y, overpotential, kept = 0.0, 0.0, 0.0
    for p in range(order):
        row[p] = blended[p]
        kept += blended[p]
        y += blended[p] * x[p]
        row[n] += tilted[p] * x[p]
    with_offset = constants[MORE_A] > 0.0
    for p in range(order, n_params - 1):
        s, lag = tap_signal[p - order], tap_lag[p - order]
        value = history[0, lag, s]
        if with_offset:
            row[n + AT_OFFSET] -= blended[p] * (history[1, lag, s] - value) / constants[MORE_A]
        if kind[s] == SOC:
            value += base / span[s]
            row[n] += blended[p] / span[s]
        elif kind[s] == FILTERED or kind[s] == SQUARED or kind[s] == RELAXATION:
            overpotential += blended[p] * (value + low[s] / span[s])
        y += blended[p] * value
        row[n] += tilted[p] * value
    y += blended[n_params - 1]
    row[n] += tilted[n_params - 1]
    return y, overpotential / (1.0 - kept)


@njit(cache=True)
def _weigh(level: np.ndarray, gains: np.ndarray, scratch: np.ndarray, steady: bool) -> float:
    """Blended size of the model's error; where they are used, the blended steady-state gains too."""
    phi, gain = scratch[VALIDITY_ROW], scratch[GAIN_ROW]
    error_level = 0.0
    for i in range(level.shape[0]):
        error_level += phi[i] * level[i]
    if steady:
        for a in range(gains.shape[1]):
            gain[a] = 0.0
            for i in range(level.shape[0]):
                gain[a] += phi[i] * gains[i, a]
    return error_level


@njit(cache=True)
def _spread(covariance: np.ndarray, scratch: np.ndarray, n: int, soc_per_A: float, moved: float) -> None:
    """Covariance of A x, in place; A has the output row on top, shifts the outputs, and counts charge."""
    size = covariance.shape[0]
    row, kept, moved_rows = scratch[OUTPUT_ROW], scratch[KEPT_ROW], scratch[MOVED_ROWS : MOVED_ROWS + size]
    offset, capacity = n + AT_OFFSET, n + AT_CAPACITY
    # A P, row by row: the first is the output's, outputs before it move down, the rest fades.
    for b in range(size):
        moved_rows[0, b] = 0.0
    for a in range(size):
        share = row[a]
        if share != 0.0:
            for b in range(size):
                moved_rows[0, b] += share * covariance[a, b]
    for lag in range(1, n):
        for b in range(size):
            moved_rows[lag, b] = covariance[lag - 1, b]
    for b in range(size):
        moved_rows[n, b] = covariance[n, b] - soc_per_A * covariance[offset, b] + moved * covariance[capacity, b]
    for a in range(n + 1, size):
        share = kept[a]
        for b in range(size):
            moved_rows[a, b] = share * covariance[a, b]
    # (A P) A', the upper half, mirrored.
    total = 0.0
    for b in range(size):
        total += moved_rows[0, b] * row[b]
    covariance[0, 0] = total
    for a in range(size):
        for b in range(max(a, 1), size):
            if b < n:
                value = moved_rows[a, b - 1]
            elif b == n:
                value = moved_rows[a, n] - soc_per_A * moved_rows[a, offset] + moved * moved_rows[a, capacity]
            else:
                value = kept[b] * moved_rows[a, b]
            covariance[a, b] = covariance[b, a] = value
