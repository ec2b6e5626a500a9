"""One hypothesis moved to the next sample: validity functions, output and its derivatives, covariance.

Called by `compiled.step` only.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.network.compiled_network import HAT, FlatNetwork
from models.network.signals.loop_form import CASCADE, DRIVEN, LOOP, SOC
from models.observer.filter.blending import Prepared, blend, blend_hats
from models.observer.filter.places import (
    AT_CAPACITY,
    AT_LOOP,
    AT_OFFSET,
    AT_QUICK,
    AT_RESISTANCE,
    AT_SLOW,
    BLENDED_ROW,
    COMPILED,
    COUNTED_ROW,
    GAIN_ROW,
    KEPT_ROW,
    LOOP_LEFT,
    MORE_A,
    MOVED_ROW,
    OUTPUT_ROW,
    Q_OUTPUT,
    QUICK_KEEP,
    QUICK_SIZE,
    R_VOLTAGE,
    SLOW_SIZE,
    STEADY,
    TILTED_ROW,
    VALIDITY_ROW,
)


# Arguments one by one, as its caller has them: each access to an array in a tuple counts a reference.
@njit(**COMPILED)
def predict(
    net: FlatNetwork,
    prepared: Prepared,
    errors: np.ndarray,
    gains: np.ndarray,
    constants: np.ndarray,
    x: np.ndarray,
    covariance: np.ndarray,
    filters: np.ndarray,
    history: np.ndarray,
    scratch: np.ndarray,
    base: float,
    moved: float,
    keep_slow: float,
    q_soc: float,
    first: bool,
    voltage: float,
) -> tuple[float, float, float]:
    """Move one hypothesis to this sample before its voltage is known.

    Returns the sizes of the model's quick and slow error here, and what the current does to the output (normalised).
    """
    order, n = net.order, max(net.order, 1)
    first_model, count = 0, errors.shape[1]
    if net.kernel == HAT:
        first_model, count = blend_hats(net, prepared.per_span, history, scratch, base), 2
    else:
        blend(prepared, net.axis_signal, net.axis_lag, net.form, history, scratch, base)
    y, overpotential = _output(net, prepared.per_span, constants[MORE_A], x, filters, history, scratch, base)
    quick, slow = _weigh(errors, gains, scratch, constants[STEADY] > 0.0, first_model, first_model + count)
    if first and order > 0:
        # No output before the first sample: start from the measurement.
        y = voltage if not np.isnan(voltage) else x[0]
        for lag in range(order):
            x[lag] = y
            covariance[lag, lag] = constants[R_VOLTAGE]
        return quick, slow, overpotential
    soc_per_A, row, kept = 0.0 if first else net.soc_per_A, scratch[OUTPUT_ROW], scratch[KEPT_ROW]
    for a in range(x.shape[0]):
        kept[a] = 1.0
    kept[n + AT_QUICK] = constants[QUICK_KEEP]
    kept[n + AT_SLOW] = kept[n + AT_RESISTANCE] = keep_slow
    _spread(n, covariance, row, kept, scratch[MOVED_ROW], scratch[COUNTED_ROW], soc_per_A, moved)
    covariance[0, 0] += constants[Q_OUTPUT]
    covariance[n, n] += q_soc
    for lag in range(n - 1, 0, -1):
        x[lag] = x[lag - 1]
    x[0] = y + row[n + AT_OFFSET] * x[n + AT_OFFSET]
    if n + AT_LOOP < x.shape[0]:
        x[0] += row[n + AT_LOOP] * x[n + AT_LOOP]
    x[n] += moved * (1.0 + x[n + AT_CAPACITY]) - soc_per_A * x[n + AT_OFFSET]
    for a in (n + AT_QUICK, n + AT_SLOW, n + AT_RESISTANCE):
        covariance[a, a] += 1.0 - kept[a] * kept[a]
        x[a] *= kept[a]
    return quick, slow, overpotential


@njit(**COMPILED)
def _output(
    net: FlatNetwork,
    per_span: np.ndarray,
    more_A: float,
    x: np.ndarray,
    filters: np.ndarray,
    history: np.ndarray,
    scratch: np.ndarray,
    base: float,
) -> tuple[float, float]:
    """Output and what the current does to it, both normalised; the output's derivatives go to the scratch space.

    The validity functions move with the state of charge too, and on a plateau the local parameters without that part
    can even have the wrong sign.
    """
    row, blended, tilted = scratch[OUTPUT_ROW], scratch[BLENDED_ROW], scratch[TILTED_ROW]
    # Taken out of the tuple once: each access counts a reference.
    forms, low, tap_signal, tap_lag = net.form, net.low, net.tap_signal, net.tap_lag
    order, n, n_params = net.order, max(net.order, 1), net.theta.shape[1]
    for a in range(x.shape[0]):
        row[a] = 0.0
    y, per_soc, of_offset, overpotential, kept = 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(order):
        row[p] = blended[p]
        kept += blended[p]
        y += blended[p] * x[p]
        per_soc += tilted[p] * x[p]
    for p in range(order, n_params - 1):
        s, lag = tap_signal[p - order], tap_lag[p - order]
        value = history[0, lag, s]
        if more_A > 0.0:
            of_offset += blended[p] * (history[1, lag, s] - value)
        form = forms[s]
        if form == SOC:
            value += base * per_span[s]
            per_soc += blended[p] * per_span[s]
        elif form >= DRIVEN or form == CASCADE:
            overpotential += blended[p] * (value + low[s] * per_span[s])
        elif form == LOOP:
            row[n + AT_LOOP] += blended[p] * filters[0, s, LOOP_LEFT] * per_span[s]
        y += blended[p] * value
        per_soc += tilted[p] * value
    row[n] = per_soc + tilted[n_params - 1]
    if more_A > 0.0:
        row[n + AT_OFFSET] = -of_offset / more_A
    return y + blended[n_params - 1], overpotential / (1.0 - kept)


@njit(**COMPILED)
def _weigh(
    errors: np.ndarray, gains: np.ndarray, scratch: np.ndarray, steady: bool, begin: int, end: int
) -> tuple[float, float]:
    """Blended sizes of the model's errors; where they are used, the blended steady-state gains too.

    Only local models `begin` to `end` count.
    """
    phi, gain = scratch[VALIDITY_ROW], scratch[GAIN_ROW]
    quick, slow = 0.0, 0.0
    for i in range(begin, end):
        quick += phi[i] * errors[QUICK_SIZE, i]
        slow += phi[i] * errors[SLOW_SIZE, i]
    if steady:
        for a in range(gains.shape[1]):
            gain[a] = 0.0
            for i in range(begin, end):
                gain[a] += phi[i] * gains[i, a]
    return quick, slow


@njit(**COMPILED)
def _spread(
    n: int,
    covariance: np.ndarray,
    row: np.ndarray,
    kept: np.ndarray,
    on_top: np.ndarray,
    counted: np.ndarray,
    soc_per_A: float,
    moved: float,
) -> None:
    """Covariance of A x, in place; A has the output row on top, shifts the outputs, counts charge, and fades the rest.

    Two rows of A P are all that is more than a shift or a factor: the output's and the state of charge's.
    """
    size = covariance.shape[0]
    offset, capacity = n + AT_OFFSET, n + AT_CAPACITY
    for b in range(size):
        on_top[b] = 0.0
        counted[b] = covariance[n, b] - soc_per_A * covariance[offset, b] + moved * covariance[capacity, b]
    for a in range(size):
        share = row[a]
        if share != 0.0:
            for b in range(size):
                on_top[b] += share * covariance[a, b]
    total = 0.0
    for b in range(size):
        total += on_top[b] * row[b]
    for a in range(n + 1, size):
        share = kept[a]
        for b in range(n + 1, size):
            covariance[a, b] *= share * kept[b]
    # Those rows first that others do not need any more.
    for lag in range(n - 1, 0, -1):
        for b in range(n + 1, size):
            covariance[lag, b] = covariance[b, lag] = kept[b] * covariance[lag - 1, b]
        covariance[lag, n] = covariance[n, lag] = counted[lag - 1]
        for b in range(n - 1, lag - 1, -1):
            covariance[lag, b] = covariance[b, lag] = covariance[lag - 1, b - 1]
        covariance[0, lag] = covariance[lag, 0] = on_top[lag - 1]
    for b in range(n + 1, size):
        covariance[n, b] = covariance[b, n] = kept[b] * counted[b]
        covariance[0, b] = covariance[b, 0] = kept[b] * on_top[b]
    covariance[n, n] = counted[n] - soc_per_A * counted[offset] + moved * counted[capacity]
    covariance[0, n] = covariance[n, 0] = on_top[n] - soc_per_A * on_top[offset] + moved * on_top[capacity]
    covariance[0, 0] = total
