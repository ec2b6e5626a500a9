"""The model's signals at a sample, as they are and with a little more current, and the past of both.

Called by `compiled.step` only.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.network.compiled_network import FlatNetwork, bent
from models.network.signals.filters import DIFFUSION_GAINS, FURTHEST_BEHIND, slower_at
from models.network.signals.loop_form import (
    AS_IS,
    CASCADE,
    DIFFUSION,
    DRIVEN,
    ENTRY_BITS,
    INVERSE_TEMPERATURE,
    LOOP,
    SOC,
    SQUARED_BIT,
    TEMPERATURE,
)
from models.network.signals.temperature_scale import KELVIN, REFERENCE_K, within_degC
from models.observer.filter.places import COMPILED, LOOP_LEFT, LOOP_VALUE


@njit(**COMPILED)
def move_on(
    net: FlatNetwork,
    per_span: np.ndarray,
    more_A: float,
    filters: np.ndarray,
    history: np.ndarray,
    current_A: float,
    flowing_A: float,
    change_A: float,
    soc: float,
    likely_soc: float,
    direction: float,
    temperature_degC: float,
    first: bool,
) -> None:
    """Move the past back by one sample, and write the signals of this one.

    The signals are those of `compiled_network.step_signals`; what both currents share is worked out once here. A
    direction is a direction: a little more current is not said to turn it, and the hysteresis follows what flows.

    Parameters
    ----------
    net : the network
    per_span : (signals,) inverse span of each signal's normalisation
    more_A : the little more current; 0 leaves the second signals out
    filters : (2, signals, 3) memory of the signals
    history : (2, lags, signals) normalised signals, newest first
    current_A, change_A : what this sample reads, and its change
    flowing_A : the same without the sensor's offset, 0 where it may be nothing else
    soc, direction, temperature_degC : of this sample; the first as far as it was counted
    likely_soc : where the hypotheses have it, for what diffuses more slowly towards empty
    first : there is no past yet
    """
    forms, poles, factor, low = net.form, net.pole, net.factor, net.low
    activation_K, exchange_A = net.activation_K, net.exchange_A
    _, depth, n_signals = history.shape
    runs = 2 if more_A > 0.0 else 1
    for run in range(runs):
        for lag in range(depth - 1, 0, -1):
            for s in range(n_signals):
                history[run, lag, s] = history[run, lag - 1, s]
    inverse_K = 1.0 / (temperature_degC + KELVIN)
    # Signals that follow each other often share their scaling by temperature and their exchange current.
    slowed, slowed_for, exchange_for, transfer, transfer_more = 1.0, 0.0, 0.0, 0.0, 0.0
    for s in range(n_signals):
        form = forms[s]
        if form >= DRIVEN or form == SOC or form == DIFFUSION:
            if activation_K[s] != slowed_for:
                slowed_for = activation_K[s]
                slowed = np.exp(slowed_for * (inverse_K - 1.0 / REFERENCE_K))
                exchange_for = 0.0
            if form < DRIVEN:
                slower = slowed
                if exchange_A[s] != 0.0:
                    slower *= slower_at(exchange_A[s], likely_soc)
                for run in range(runs):
                    history[run, 0, s] = soc if form == SOC else 0.0
                for mode in range(3 if factor[s] != 0.0 else 0):
                    keep = np.exp(-poles[s, mode] / slower)
                    for run in range(runs):
                        value = (current_A + run * more_A) * slower
                        moved = keep * filters[run, s, mode] + (1.0 - keep) * DIFFUSION_GAINS[mode] * value
                        filters[run, s, mode] = moved
                        history[run, 0, s] += factor[s] * moved
                for run in range(runs if form == DIFFUSION else 0):
                    history[run, 0, s] = min(max(history[run, 0, s], -FURTHEST_BEHIND), FURTHEST_BEHIND)
            else:
                keep, entry, squared = poles[s, 0], form & ENTRY_BITS, form & SQUARED_BIT
                if exchange_A[s] != exchange_for and exchange_A[s] != 0.0:
                    exchange_for = exchange_A[s]
                    transfer = np.arcsinh(current_A * slowed / exchange_for)
                    if runs == 2:
                        transfer_more = np.arcsinh((current_A + more_A) * slowed / exchange_for)
                for run in range(runs):
                    value = (current_A + run * more_A) * slowed
                    if exchange_A[s] != 0.0:
                        value = transfer if run == 0 else transfer_more
                    if entry != AS_IS:
                        value = bent(entry, value)
                    value = keep * filters[run, s, 0] + (1.0 - keep) * value
                    filters[run, s, 0] = value
                    history[run, 0, s] = value * abs(value) if squared else value
        else:
            value = direction
            if form == CASCADE:
                value = change_A
                for stage in range(3):
                    value = poles[s, stage] * filters[0, s, stage] + (1.0 - poles[s, stage]) * value
                    filters[0, s, stage] = value
                value /= 1.0 - poles[s, 0]
            elif form == LOOP:
                keep = np.exp(-factor[s] * abs(flowing_A))
                value = keep * filters[0, s, LOOP_VALUE] + (1.0 - keep) * np.sign(flowing_A)
                filters[0, s, LOOP_VALUE] = value
                filters[0, s, LOOP_LEFT] = keep * (1.0 if first else filters[0, s, LOOP_LEFT])
            elif form == TEMPERATURE:
                value = within_degC(temperature_degC, poles[s, 0], poles[s, 1])
            elif form == INVERSE_TEMPERATURE:
                value = inverse_K
            for run in range(runs):
                history[run, 0, s] = value
        for run in range(runs):
            history[run, 0, s] = (history[run, 0, s] - low[s]) * per_span[s]
    if first:
        for run in range(runs):
            for lag in range(1, depth):
                for s in range(n_signals):
                    history[run, lag, s] = history[run, 0, s]
