"""The free run and its sensitivities: linear time-varying recursions, compiled.

The validity functions depend on SoC, direction and temperature, never on the output, so the free run is
y(k) = a_1(k) y(k-1) + a_2(k) y(k-2) + f(k) with coefficients known beforehand.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.data.timeseries import FloatArray
from models.network.regression import Dataset


@njit(cache=True)
def run_recursion(a: np.ndarray, f: np.ndarray, y: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Solve the recursion.

    Parameters
    ----------
    a : (N, n) blended output coefficients
    f : (N,) blended contribution of inputs and offset
    y : (N,) measured output; only the first n values of each part are used, as initial values
    starts : first index of each part

    Returns
    -------
    (N,) simulated output; a missing initial value is replaced by the static response.
    """
    n_samples, order = a.shape
    out = np.empty(n_samples)
    part = -1
    since = 0
    for k in range(n_samples):
        if part + 1 < len(starts) and k == starts[part + 1]:
            part += 1
            since = 0
        if since < order:
            value = y[k]
            if np.isnan(value):
                gain = 1.0
                for j in range(order):
                    gain -= a[k, j]
                value = out[k - 1] if since > 0 else f[k] / gain
            out[k] = value
        else:
            total = f[k]
            for j in range(order):
                total += a[k, j] * out[k - 1 - j]
            out[k] = total
        since += 1
    return out


@njit(cache=True)
def sensitivity_block(
    first: int,
    validity: np.ndarray,
    u: np.ndarray,
    y_sim: np.ndarray,
    a: np.ndarray,
    is_start: np.ndarray,
    carry: np.ndarray,
    out: np.ndarray,
) -> None:
    """Sensitivities of the free run to all local parameters over one block of samples.

    s(k) = Phi_i(k) phi_j(k) + sum_l a_l(k) s(k-l), the exact derivative of the recursion.

    Parameters
    ----------
    first : index of the block's first sample
    validity, u, y_sim, a : as in the free run, over all samples
    is_start : (N,) 1 at the samples that hold initial values (their sensitivity is 0)
    carry : (n, M * p) last sensitivities before the block, newest first; updated
    out : (block, M * p), written
    """
    order = a.shape[1]
    n_models = validity.shape[1]
    n_inputs = u.shape[1]
    width = order + n_inputs
    for b in range(out.shape[0]):
        k = first + b
        if is_start[k]:
            for c in range(out.shape[1]):
                out[b, c] = 0.0
        else:
            for i in range(n_models):
                weight = validity[k, i]
                base = i * width
                for j in range(order):
                    out[b, base + j] = weight * y_sim[k - 1 - j]
                for j in range(n_inputs):
                    out[b, base + order + j] = weight * u[k, j]
            for lag in range(order):
                coefficient = a[k, lag]
                for c in range(out.shape[1]):
                    out[b, c] += coefficient * carry[lag, c]
        if order == 2:
            for c in range(out.shape[1]):
                carry[1, c] = carry[0, c]
        if order >= 1:
            for c in range(out.shape[1]):
                carry[0, c] = out[b, c]


def samples_since_start(n_samples: int, starts: np.ndarray) -> np.ndarray:
    """(N,) how many samples each one is away from its part's start."""
    index = np.arange(n_samples)
    return index - starts[np.searchsorted(starts, index, side="right") - 1]


def initial_samples(n_samples: int, starts: np.ndarray, order: int) -> np.ndarray:
    """(N,) 1 at the samples of each part that hold measured initial values."""
    return (samples_since_start(n_samples, starts) < order).astype(np.uint8)


def one_step_regressors(data: Dataset, order: int) -> FloatArray:
    """Regressors with measured past outputs; NaN where one is missing or lies before its part's start."""
    phi = np.empty((len(data), order + data.u.shape[1]))
    phi[:, order:] = data.u
    for lag in range(1, order + 1):
        column = np.full(len(data), np.nan)
        column[lag:] = data.y[:-lag]
        for start in data.starts:
            column[start : start + lag] = np.nan
        phi[:, lag - 1] = column
    return phi


def blend(theta: FloatArray, order: int, validity: FloatArray, data: Dataset) -> tuple[FloatArray, FloatArray]:
    """Blended output coefficients a(k) and input contribution f(k) of the free run."""
    coefficients = validity @ theta
    a = np.ascontiguousarray(coefficients[:, :order])
    f = np.einsum("kp,kp->k", coefficients[:, order:], data.u)
    return a, f


def free_run(theta: FloatArray, order: int, validity: FloatArray, data: Dataset) -> FloatArray:
    """Free run in normalised units."""
    a, f = blend(theta, order, validity, data)
    return run_recursion(a, f, data.y, data.starts)
