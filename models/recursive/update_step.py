"""One recursive update of a live network as a compiled function of plain arrays; live and replay both call it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from models.network.compiled_network import HAT, FlatNetwork, step_signals, step_validity

# Columns of the output row.
VOLTAGE_OUT, ERROR_OUT, ERROR_STD_OUT = range(3)
N_OUT = 3
# Entries of the held values.
CURRENT, DIRECTION, SOC, TEMPERATURE, SEEN = range(5)
N_HELD = 5
# Poles that the free run keeps: any blend of local models within it is stable for one past output, and real poles
# within it have coefficients in a convex set for two.
POLE_LIMIT = 0.9995
_LOWER_POLE = -0.5
# A larger error than this many of its standard deviations is a spike as far as the parameters are concerned.
_SPIKE = 4.0
# Sensitivities beyond this stand for inputs that no cell sees; nothing is learned from them.
_LARGEST = 1e6


class FlatUpdate(NamedTuple):
    """What the recursion knows beforehand, in normalised units."""

    prior: np.ndarray  # (M, p, p) covariance that the parameters fall back to
    low: np.ndarray  # (M, p) range that each parameter is kept in
    high: np.ndarray
    noise: float  # variance of the voltage's noise with the model's own error
    forgetting: float  # share of what is known that a sample in the middle of a local model forgets
    at_rest: np.ndarray  # (M, p) regressors in the middle of each local model, at rest and settled
    rest_low: np.ndarray  # (M,) range that the output there is kept in; of hats only
    rest_high: np.ndarray


# Arguments one by one: from Python a named tuple of seven arrays costs 0.5 to 0.8 us more at each live sample.
@njit(cache=True)
def step(
    net: FlatNetwork,
    rule: FlatUpdate,
    # memory, updated in place
    theta: np.ndarray,
    covariance: np.ndarray,
    filters: np.ndarray,
    history: np.ndarray,
    past: np.ndarray,
    sensitivity: np.ndarray,
    held: np.ndarray,
    # the sample
    current_A: float,
    voltage: float,
    temperature_degC: float,
    soc: float,
    out: np.ndarray,
) -> None:
    """Advance by one sample.

    Parameters
    ----------
    net, rule : the network as it was, and the recursion's settings
    theta : (M, p); covariance : (M, p, p)
    filters : (S, 3), history : (depth, S) of the signals
    past : (max(n, 1),) simulated outputs, newest first; sensitivity : (max(n, 1), M, p) of these
    held : (N_HELD,) last current, direction, SoC, temperature, samples seen
    current_A, voltage (normalised), temperature_degC, soc : NaN = missing; a missing SoC is counted
    out : (N_OUT,) written: simulated output before the update, its error (NaN = missing) and that one's variance
    """
    _signals(net, filters, history, held, current_A, temperature_degC, soc)
    n_models, n_params = theta.shape
    weight, phi = np.empty(n_models), np.empty(n_params)
    first, last = step_validity(net, history, weight)
    for p in range(n_params):
        if p < net.order:
            phi[p] = past[p]
        elif p < n_params - 1:
            phi[p] = history[net.tap_lag[p - net.order], net.tap_signal[p - net.order]]
        else:
            phi[p] = 1.0
    poles, y = np.zeros(max(net.order, 1)), 0.0
    for p in range(n_params):
        blended = 0.0
        for i in range(first, last):
            blended += weight[i] * theta[i, p]
        if p < net.order:
            poles[p] = blended
        y += blended * phi[p]
    begins = held[SEEN] < net.order
    if begins:
        y = _first_output(net, poles, phi, y, past, held, voltage)
    held[SEEN] += 1.0
    psi = np.zeros((n_models, n_params))
    largest = 0.0
    if not begins:
        for i in range(first, last):
            for p in range(n_params):
                value = weight[i] * phi[p]
                for lag in range(net.order):
                    value += poles[lag] * sensitivity[lag, i, p]
                psi[i, p] = value
                largest = max(largest, abs(value))
    if not (np.isfinite(y) and largest < _LARGEST):
        # Nothing is learned from an input beyond all bounds; the free run begins anew from what was measured.
        y = voltage if np.isfinite(voltage) else 0.5
        psi[:] = 0.0
        begins = True
    out[VOLTAGE_OUT], out[ERROR_OUT], out[ERROR_STD_OUT] = y, voltage - y, rule.noise
    for lag in range(past.shape[0] - 1, 0, -1):
        past[lag] = past[lag - 1]
        sensitivity[lag] = sensitivity[lag - 1]
    past[0] = y
    sensitivity[0] = psi
    if not begins and np.isfinite(voltage):
        out[ERROR_STD_OUT] = _learn(rule, theta, covariance, weight, psi, voltage - y, first, last)
        for i in range(first, last):
            _keep_stable(theta[i], net.order)
            if net.kernel == HAT:
                _keep_rising(rule, theta[i], i)


@njit(cache=True)
def _signals(
    net: FlatNetwork,
    filters: np.ndarray,
    history: np.ndarray,
    held: np.ndarray,
    current_A: float,
    temperature_degC: float,
    soc: float,
) -> None:
    """Move the signals on by one sample; what is missing stays as it was."""
    if not np.isfinite(current_A):
        current_A = held[CURRENT]
    if np.isfinite(temperature_degC):
        held[TEMPERATURE] = temperature_degC
    first = held[SEEN] == 0.0
    if first:
        held[CURRENT] = current_A
    if current_A > net.rest_A:
        held[DIRECTION] = 1.0
    elif current_A < -net.rest_A:
        held[DIRECTION] = -1.0
    if np.isfinite(soc):
        held[SOC] = soc
    elif not first:
        held[SOC] += (net.efficiency if current_A > 0.0 else 1.0) * current_A * net.soc_per_A
    for lag in range(history.shape[0] - 1, 0, -1):
        history[lag] = history[lag - 1]
    change_A = current_A - held[CURRENT]
    step_signals(net, filters, history[0], current_A, change_A, held[SOC], held[DIRECTION], held[TEMPERATURE])
    held[CURRENT] = current_A
    if first:
        for lag in range(1, history.shape[0]):
            history[lag] = history[0]


@njit(cache=True)
def _first_output(
    net: FlatNetwork,
    poles: np.ndarray,
    phi: np.ndarray,
    y: float,
    past: np.ndarray,
    held: np.ndarray,
    voltage: float,
) -> float:
    """Output of a sample with too few before it: as measured, else as before, else settled."""
    if np.isfinite(voltage):
        return voltage
    if held[SEEN] > 0.0:
        return past[0]
    gain = 1.0
    for lag in range(net.order):
        y -= poles[lag] * phi[lag]
        gain -= poles[lag]
    return y / gain


@njit(cache=True)
def _learn(
    rule: FlatUpdate,
    theta: np.ndarray,
    covariance: np.ndarray,
    weight: np.ndarray,
    psi: np.ndarray,
    error: float,
    first: int,
    last: int,
) -> float:
    """Correct all local models by their share of the error and move their covariances on; returns its variance.

    Those before `first` and from `last` on have no share.
    """
    n_models, n_params = theta.shape
    gain = np.zeros((n_models, n_params))
    variance = rule.noise
    for i in range(first, last):
        for p in range(n_params):
            total = 0.0
            for q in range(n_params):
                total += covariance[i, p, q] * psi[i, q]
            gain[i, p] = total
            variance += total * psi[i, p]
    bound = _SPIKE * np.sqrt(variance)
    corrected = min(max(error, -bound), bound)
    for i in range(first, last):
        forget = rule.forgetting * weight[i]
        for p in range(n_params):
            moved = theta[i, p] + gain[i, p] * corrected / variance
            theta[i, p] = min(max(moved, rule.low[i, p]), rule.high[i, p])
            for q in range(n_params):
                kept = covariance[i, p, q] - gain[i, p] * gain[i, q] / variance
                # Towards the prior instead of by a common factor: what is not excited cannot blow up.
                covariance[i, p, q] = kept + forget * (rule.prior[i, p, q] - kept)
    return variance


@njit(cache=True)
def _keep_rising(rule: FlatUpdate, row: np.ndarray, model: int) -> None:
    """Move the offset of one local model by hats so that its voltage at rest stays between those of its neighbours."""
    rest = 0.0
    for p in range(row.shape[0]):
        rest += row[p] * rule.at_rest[model, p]
    row[-1] += min(max(rest, rule.rest_low[model]), rule.rest_high[model]) - rest


@njit(cache=True)
def _keep_stable(row: np.ndarray, order: int) -> None:
    """Pull the poles of one local model inside the unit circle."""
    if order == 1:
        row[0] = min(max(row[0], 0.0), POLE_LIMIT)
    elif order == 2:
        half, root = 0.5 * row[0], 0.25 * row[0] * row[0] + row[1]
        spread = np.sqrt(max(root, 0.0))
        slow = min(max(half + spread, _LOWER_POLE), POLE_LIMIT)
        fast = min(max(half - spread, _LOWER_POLE), POLE_LIMIT)
        row[0], row[1] = slow + fast, -slow * fast


# Arguments as `step` has them.
@njit(cache=True)
def replay(
    net: FlatNetwork,
    rule: FlatUpdate,
    theta: np.ndarray,
    covariance: np.ndarray,
    filters: np.ndarray,
    history: np.ndarray,
    past: np.ndarray,
    sensitivity: np.ndarray,
    held: np.ndarray,
    current_A: np.ndarray,
    voltage: np.ndarray,
    temperature_degC: np.ndarray,
    soc: np.ndarray,
    out: np.ndarray,
) -> None:
    """Run `step` over whole arrays; `out` is (N, N_OUT)."""
    for k in range(current_A.shape[0]):
        step(
            net, rule, theta, covariance, filters, history, past, sensitivity, held,
            current_A[k], voltage[k], temperature_degC[k], soc[k], out[k],
        )  # fmt: skip
