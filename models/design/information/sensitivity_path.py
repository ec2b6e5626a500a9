"""Parameter sensitivities of a network over a run, and their adjoint: both linear in samples times parameters.

Forwards: validity Phi, output y and psi(k) = Phi(k) x phi(k), where asked for carried through the output recursion,
s(k) = psi(k) + sum_l a_l(k) s(k-l). Backwards: from the derivatives of a criterion to each sensitivity to those to each
signal; mu(k) = w(k) + sum_l a_l(k+l) mu(k+l) undoes the recursion of the sensitivities, lambda(k) that of the output.

Arrays hold the K local models that can count at a sample, from model `first[k]` on: all M of them, or the two next
knots of hats.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.network.compiled_network import HAT, FlatNetwork
from models.network.hats import hat_interval, hat_slope
from models.network.signals.temperature_scale import inside_trained
from models.network.structure import KERNELS

_GAUSSIAN, _TRIANGULAR = KERNELS.index("gaussian"), KERNELS.index("triangular")


@njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def sensitivities(
    net: FlatNetwork,
    signals: np.ndarray,
    free_run: bool,
    first: np.ndarray,
    validity: np.ndarray,
    blended: np.ndarray,
    y: np.ndarray,
    psi: np.ndarray,
) -> None:
    """Simulate and differentiate to the parameters.

    Parameters
    ----------
    net : the network
    signals : (N, S) normalised signals
    free_run : whether the sensitivities run through the past outputs
    first : (N,) the first of the local models that can count, written
    validity : (N, K), written
    blended : (N, p) blended parameters, written
    y : (N,) normalised output, written; it begins settled at the first sample
    psi : (N, K p) sensitivities, written; those of the first samples, which hold initial values, are 0
    """
    n_samples = signals.shape[0]
    n_models, n_params = validity.shape[1], net.theta.shape[1]
    order, n_taps = net.order, net.tap_signal.shape[0]
    phi, sharpness = np.empty(n_params), 1.0 / net.widths
    phi[n_params - 1] = 1.0
    for k in range(n_samples):
        first[k] = 0
        if net.kernel == _GAUSSIAN:
            _gaussian_validity(net, sharpness, signals, k, validity[k])
        elif net.kernel == HAT:
            first[k], share = hat_interval(net.centres, _axis_value(net, 0, signals, k))
            validity[k, 0], validity[k, 1] = 1.0 - share, share
        else:
            _bounded_validity(net, signals, k, validity[k])
        for p in range(n_params):
            blended[k, p] = 0.0
        for i in range(n_models):
            weight, theta = validity[k, i], net.theta[first[k] + i]
            for p in range(n_params):
                blended[k, p] += weight * theta[p]
        f = blended[k, n_params - 1]
        for t in range(n_taps):
            phi[order + t] = signals[max(k - net.tap_lag[t], 0), net.tap_signal[t]]
            f += blended[k, order + t] * phi[order + t]
        if k < order:
            gain = 1.0
            for j in range(order):
                gain -= blended[k, j]
            y[k] = y[k - 1] if k > 0 else f / gain
            psi[k] = 0.0
            continue
        for j in range(order):
            phi[j] = y[k - 1 - j]
            f += blended[k, j] * phi[j]
        y[k] = f
        row = psi[k]
        for i in range(n_models):
            weight, base = validity[k, i], i * n_params
            for p in range(n_params):
                row[base + p] = weight * phi[p]
        if free_run:
            for lag in range(order):
                a, before = blended[k, lag], psi[k - 1 - lag]
                for c in range(n_models * n_params):
                    row[c] += a * before[c]


@njit(cache=True)
def _axis_value(net: FlatNetwork, axis: int, signals: np.ndarray, k: int) -> float:
    """Partition variable of one sample."""
    s = net.axis_signal[axis]
    return inside_trained(int(net.form[s]), float(signals[max(k - net.axis_lag[axis], 0), s]))


@njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def _gaussian_validity(net: FlatNetwork, sharpness: np.ndarray, signals: np.ndarray, k: int, out: np.ndarray) -> None:
    """Validity functions of one sample, as `Partition.validity` has them."""
    n_models, n_axes = net.centres.shape
    out[:] = 0.0
    for j in range(n_axes):
        z = _axis_value(net, j, signals, k)
        for i in range(n_models):
            away = (z - net.centres[i, j]) * sharpness[i, j]
            out[i] += 0.5 * away * away
    nearest = out[0]
    for i in range(n_models):
        nearest = min(nearest, out[i])
    total = 0.0
    for i in range(n_models):
        out[i] = np.exp(nearest - out[i])
        total += out[i]
    total = 1.0 / total
    for i in range(n_models):
        out[i] *= total


@njit(cache=True)
def _bounded_validity(net: FlatNetwork, signals: np.ndarray, k: int, out: np.ndarray) -> None:
    """Validity functions of one sample with a uniform or triangular kernel; where none reaches, the nearest has all."""
    n_models, n_axes = net.centres.shape
    nearest, far, total = 0, np.inf, 0.0
    for i in range(n_models):
        squared, kernel = 0.0, 1.0
        for j in range(n_axes):
            z = _axis_value(net, j, signals, k)
            distance = abs(z - net.centres[i, j]) / net.widths[i, j]
            squared += distance * distance
            if net.kernel == _TRIANGULAR:
                kernel *= max(1.0 - 0.5 * distance, 0.0)
            elif distance > 1.0:
                kernel = 0.0
        out[i] = kernel
        total += kernel
        if squared < far:
            far, nearest = squared, i
    if total <= 0.0:
        out[nearest] = total = 1.0
    for i in range(n_models):
        out[i] /= total


# Arguments one by one: with fast mathematics another form of the call may round otherwise.
@njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def signal_gradient(
    net: FlatNetwork,
    signals: np.ndarray,
    free_run: bool,
    first: np.ndarray,
    validity: np.ndarray,
    blended: np.ndarray,
    y: np.ndarray,
    psi: np.ndarray,
    weights: np.ndarray,
    by_output: np.ndarray,
    by_signal: np.ndarray,
) -> None:
    """Carry derivatives to the sensitivities and the output back to the signals.

    Parameters
    ----------
    net, signals, free_run, first, validity, blended, y, psi : as `sensitivities` left them
    weights : (N, K p) derivative of a criterion to each sensitivity; overwritten
    by_output : (N,) derivative of the criterion to each output; overwritten
    by_signal : (N, S) written
    """
    n_models, n_params = validity.shape[1], net.theta.shape[1]
    n_samples, n_taps, order = signals.shape[0], net.tap_signal.shape[0], net.order
    phi, by_phi, by_validity = np.empty(n_params), np.empty(n_params), np.empty(n_models)
    sharpness = 1.0 / net.widths
    phi[n_params - 1] = 1.0
    by_signal[:, :] = 0.0
    for k in range(n_samples - 1, order - 1, -1):
        if free_run:
            for lag in range(order):
                if k + 1 + lag < n_samples:
                    a, row, after = blended[k + 1 + lag, lag], weights[k], weights[k + 1 + lag]
                    for c in range(n_models * n_params):
                        row[c] += a * after[c]
        for j in range(order):
            phi[j] = y[k - 1 - j]
        for t in range(n_taps):
            phi[order + t] = signals[max(k - net.tap_lag[t], 0), net.tap_signal[t]]
        _by_regressor(net, k, free_run, first, validity, blended, psi, weights, by_output[k], phi, by_phi, by_validity)
        for j in range(order):
            by_output[k - 1 - j] += by_phi[j]
        for t in range(n_taps):
            by_signal[max(k - net.tap_lag[t], 0), net.tap_signal[t]] += by_phi[order + t]
        if net.kernel == HAT:
            slope = hat_slope(net.centres, first[k], _axis_value(net, 0, signals, k))
            row = max(k - net.axis_lag[0], 0)
            by_signal[row, net.axis_signal[0]] += slope * (by_validity[1] - by_validity[0])
        else:
            _by_axes(net, sharpness, signals, k, validity[k], by_validity, by_signal)


# Arguments one by one: with fast mathematics another form of the call may round otherwise.
@njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def _by_regressor(
    net: FlatNetwork,
    k: int,
    free_run: bool,
    first: np.ndarray,
    validity: np.ndarray,
    blended: np.ndarray,
    psi: np.ndarray,
    weights: np.ndarray,
    adjoint: float,
    phi: np.ndarray,
    by_phi: np.ndarray,
    by_validity: np.ndarray,
) -> None:
    """Derivatives to one sample's regressors and validity functions; `adjoint` is that to its output."""
    n_models, n_params = validity.shape[1], net.theta.shape[1]
    for p in range(n_params):
        by_phi[p] = adjoint * blended[k, p]
    for i in range(n_models):
        row, theta = weights[k, i * n_params : (i + 1) * n_params], net.theta[first[k] + i]
        weight, total = validity[k, i], 0.0
        for p in range(n_params):
            by_phi[p] += weight * row[p]
            total += phi[p] * (row[p] + adjoint * theta[p])
        by_validity[i] = total
    if free_run:
        for lag in range(net.order):
            through, row, before = 0.0, weights[k], psi[k - 1 - lag]
            for c in range(n_models * n_params):
                through += row[c] * before[c]
            for i in range(n_models):
                by_validity[i] += net.theta[first[k] + i, lag] * through


@njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def _by_axes(
    net: FlatNetwork,
    sharpness: np.ndarray,
    signals: np.ndarray,
    k: int,
    validity: np.ndarray,
    by_validity: np.ndarray,
    by_signal: np.ndarray,
) -> None:
    """Add the derivatives to one sample's partition variables; a uniform kernel and one that is held have none."""
    n_models, n_axes = net.centres.shape
    mean = 0.0
    for i in range(n_models):
        mean += validity[i] * by_validity[i]
    for j in range(n_axes):
        row = max(k - net.axis_lag[j], 0)
        z = signals[row, net.axis_signal[j]]
        if z != _axis_value(net, j, signals, k):
            continue
        total = 0.0
        for i in range(n_models):
            away = (z - net.centres[i, j]) * sharpness[i, j]
            slope = 0.0
            if net.kernel == _GAUSSIAN:
                slope = -away * sharpness[i, j]
            elif net.kernel == _TRIANGULAR and 0.0 < abs(away) < 2.0:
                slope = -0.5 * np.sign(away) * sharpness[i, j] / (1.0 - 0.5 * abs(away))
            total += validity[i] * (by_validity[i] - mean) * slope
        by_signal[row, net.axis_signal[j]] += total
