"""Least squares on the free-run error for networks whose local models share their poles.

With past outputs weighted alike in all local models, y(k) = a_1 y(k-1) + ... + sum_i Phi_i(k) b_i' u(k), the free run
is linear in all b_i: its regressors are Phi_i u_j passed through the common filter 1 / (1 - a_1 q^-1 - ...). The fit is
one convex problem, stable for any data, and judging it on held-out samples costs one small linear solve, because the
moments of groups of samples add up. Local poles are freed afterwards (see `output_error`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from models.data.timeseries import FloatArray
from models.identification.penalty_strengths import Factored, StrengthJudge
from models.network.partition import Partition
from models.network.recursion import samples_since_start
from models.network.regression import Dataset
from models.network.structure import Structure

_BLOCK = 4096


@dataclass(frozen=True)
class Moments:
    """Products of filtered regressors and output, summed over each group of samples.

    Attributes
    ----------
    xx : (G, P, P); xy : (G, P); yy : (G,); count : (G,) samples
    """

    xx: FloatArray
    xy: FloatArray
    yy: FloatArray
    count: FloatArray


@dataclass(frozen=True)
class SharedPoleFit:
    """Parameters with their regularisation.

    Attributes
    ----------
    b : (M, q) input parameters of each local model
    log_strengths : powers of ten of the penalties, chosen on held-out samples
    held_out_mse : mean squared free-run error on held-out samples, normalised units
    penalty : (P, P) matrix that was added to the information
    """

    b: FloatArray
    log_strengths: tuple[float, ...]
    held_out_mse: float
    penalty: FloatArray


def output_coefficients(time_constants_s: tuple[float, ...], dt_s: float) -> FloatArray:
    """Coefficients a_1 ... a_n of the filter with real poles exp(-dt / time constant)."""
    poles = np.exp(-dt_s / np.asarray(time_constants_s, dtype=np.float64))
    return -np.poly(poles)[1:] if len(poles) else np.zeros(0)


def moments(partition: Partition, data: Dataset, a: FloatArray, group: np.ndarray, keep_every: int = 1) -> Moments:
    """Moments of each group.

    Parameters
    ----------
    partition : validity functions' boxes
    data : training samples
    a : (n,) shared output coefficients
    group : (N,) group of each sample
    keep_every : use only every n-th sample in the sums (all pass through the filter); neighbours tell the same
    """
    if len(a) == 0:
        usable = ~np.isnan(data.y) & (np.arange(len(data)) % keep_every == 0)
        return _static_moments(partition, data, usable, group)
    validity = partition.validity(data.z)
    since = samples_since_start(len(data), data.starts)
    target = data.y - initial_response(np.nan_to_num(data.y), a, since)
    usable = ~np.isnan(data.y) & (since >= len(a)) & (np.arange(len(data)) % keep_every == 0)
    size, n_groups = validity.shape[1] * data.u.shape[1], int(group.max()) + 1
    xx, xy = np.zeros((n_groups, size, size)), np.zeros((n_groups, size))
    yy, count = np.zeros(n_groups), np.zeros(n_groups)
    carry, block = np.zeros((max(len(a), 1), size)), np.empty((_BLOCK, size))
    for first in range(0, len(data), _BLOCK):
        rows = block[: min(_BLOCK, len(data) - first)]
        _filtered_regressors(first, validity, data.u, a, since, carry, rows)
        part = slice(first, first + len(rows))
        for g in np.unique(group[part]):
            chosen = usable[part] & (group[part] == g)
            x, y = rows[chosen], target[part][chosen]
            xx[g] += x.T @ x
            xy[g] += x.T @ y
            yy[g] += y @ y
            count[g] += len(y)
    return Moments(xx, xy, yy, count)


def _static_moments(partition: Partition, data: Dataset, usable: np.ndarray, group: np.ndarray) -> Moments:
    """Without output feedback nothing passes through a filter: only the samples that count are touched."""
    size, n_groups = partition.n_models * data.u.shape[1], int(group.max()) + 1
    xx, xy = np.zeros((n_groups, size, size)), np.zeros((n_groups, size))
    yy, count = np.zeros(n_groups), np.zeros(n_groups)
    for g in range(n_groups):
        chosen = np.flatnonzero(usable & (group == g))
        for first in range(0, len(chosen), _BLOCK):
            k = chosen[first : first + _BLOCK]
            x = (partition.validity(data.z[k])[:, :, None] * data.u[k][:, None, :]).reshape(len(k), size)
            xx[g] += x.T @ x
            xy[g] += x.T @ data.y[k]
            yy[g] += data.y[k] @ data.y[k]
            count[g] += len(k)
    return Moments(xx, xy, yy, count)


def filtered(data: Dataset, a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, q) inputs after the common filter, and (N,) outputs less what the measured initial values bring.

    A local model's part in the free run is nearly its validity times these inputs, as validity changes slowly.
    """
    if len(a) == 0:
        return data.u, data.y
    from scipy.signal import lfilter  # Lazy: 0.4 s of processor time, which a network without feedback does without.

    since = samples_since_start(len(data), data.starts)
    target = data.y - initial_response(np.nan_to_num(data.y), a, since)
    inputs = np.where((since < len(a))[:, None], 0.0, data.u)
    for part in np.split(np.arange(len(data)), data.starts[1:]):
        inputs[part] = lfilter([1.0], [1.0, *-a], inputs[part], axis=0)
    target[since < len(a)] = np.nan
    return inputs, target


def penalties(structure: Structure, partition: Partition, data: Dataset, a: FloatArray) -> list[FloatArray]:
    """Quadratic forms that pull neighbouring local models together, in terms of their static voltage.

    Four, each to be weighted on its own: differences of the open-circuit line (SoC and offset) and of all other
    parameters, between neighbours along the SoC and along the other axes. Along the SoC the two lines should meet and
    bend gently; across direction and temperature the open-circuit voltage hardly changes, while resistances may.

    Returns
    -------
    list of (P, P)
    """
    q, n_models = data.u.shape[1], partition.n_models
    line = [tap - structure.output_order for tap in structure.soc_regressors()]
    other = [j for j in range(q - 1) if j not in line]
    gain = 1.0 / (1.0 - float(np.sum(a)))
    scale = np.sqrt(np.mean(data.u**2, axis=0))
    soc_axis = structure.soc_axis
    apart = np.zeros(q)
    apart[other] = (gain * scale[other]) ** 2
    rows: list[list[FloatArray]] = [[], []]
    linked = np.zeros((2, n_models, n_models))
    for i, j in partition.neighbours():
        across = int(_shared_axis(partition, i, j) != soc_axis)
        linked[across, [i, j], [j, i]] = 1.0
        for probe in _probes(partition, i, j, soc_axis, across == 0):
            row = np.zeros((n_models, q))
            row[i, line], row[i, q - 1] = gain * probe, gain
            row[j] = -row[i]
            rows[across].append(row.ravel())
    size = n_models * q
    lines = [np.array(found).reshape(-1, size) for found in rows]
    others = [np.kron(np.diag(links.sum(axis=1)) - links, np.diag(apart)) for links in linked]
    return [*(found.T @ found for found in lines), *others]


def compare(
    sums: Moments, forms: list[FloatArray], start: tuple[float, ...] | None, hopeless_mse: float
) -> tuple[tuple[float, ...], float]:
    """Strengths near `start` and the held-out error, less exactly where that stays above `hopeless_mse`."""
    strengths, mse = StrengthJudge.of(sums.xx, sums.xy, sums.yy, sums.count, forms).best(start, hopeless_mse)
    return tuple(strengths.tolist()), mse


def fit(sums: Moments, forms: list[FloatArray], start: tuple[float, ...] | None = None) -> SharedPoleFit:
    """Choose the penalties' strengths on held-out groups, then fit all groups.

    Parameters
    ----------
    sums : moments of each group
    forms : penalties
    start : powers of ten that served a similar candidate; the search begins there and once more without them
    """
    judge = StrengthJudge.of(sums.xx, sums.xy, sums.yy, sums.count, forms)
    # What served on fewer samples can lie in a side valley of the error on all of them.
    strengths, mse = min((judge.best(first) for first in dict.fromkeys((start, None))), key=lambda found: found[1])
    weighted = [10.0**s * form for s, form in zip(strengths, forms, strict=True)]
    penalty = np.add.reduce(weighted) * float(sums.count.sum())
    b = Factored.of(sums.xx.sum(axis=0) + penalty).solve(sums.xy.sum(axis=0))
    return SharedPoleFit(b, tuple(strengths.tolist()), mse, penalty)


def solve_without(sums: Moments, penalty: FloatArray, held: np.ndarray) -> FloatArray:
    """Parameters fitted to all groups but those in `held`, with the penalty in proportion."""
    kept = np.setdiff1d(np.arange(len(sums.count)), held)
    share = sums.count[kept].sum() / max(sums.count.sum(), 1.0)
    return Factored.of(sums.xx[kept].sum(axis=0) + share * penalty).solve(sums.xy[kept].sum(axis=0))


def _shared_axis(partition: Partition, i: int, j: int) -> int:
    overlap = np.minimum(partition.upper[i], partition.upper[j]) - np.maximum(partition.lower[i], partition.lower[j])
    return int(np.argmin(np.abs(overlap)))


def _probes(partition: Partition, i: int, j: int, soc_axis: int, along_soc: bool) -> tuple[float, float]:
    """Where two lines are compared: at both centres along the SoC, else at the ends of the SoC range they share."""
    if soc_axis < 0:
        return (0.0, 1.0)
    if along_soc:
        return (float(partition.centres[i, soc_axis]), float(partition.centres[j, soc_axis]))
    low = max(partition.lower[i, soc_axis], partition.lower[j, soc_axis])
    high = min(partition.upper[i, soc_axis], partition.upper[j, soc_axis])
    return (float(low), float(high))


@njit(cache=True)
def _filtered_regressors(
    first: int,
    validity: np.ndarray,
    u: np.ndarray,
    a: np.ndarray,
    since: np.ndarray,
    carry: np.ndarray,
    out: np.ndarray,
) -> None:
    """Rows of Phi_i u_j passed through the common filter; `carry` (n, P) holds the last rows, newest first."""
    order, n_models, q = a.shape[0], validity.shape[1], u.shape[1]
    for row in range(out.shape[0]):
        k = first + row
        if since[k] < order:
            for c in range(out.shape[1]):
                out[row, c] = 0.0
        else:
            for i in range(n_models):
                weight = validity[k, i]
                for j in range(q):
                    out[row, i * q + j] = weight * u[k, j]
            for lag in range(order):
                for c in range(out.shape[1]):
                    out[row, c] += a[lag] * carry[lag, c]
        for lag in range(order - 1, 0, -1):
            for c in range(out.shape[1]):
                carry[lag, c] = carry[lag - 1, c]
        if order > 0:
            for c in range(out.shape[1]):
                carry[0, c] = out[row, c]


@njit(cache=True)
def initial_response(y: np.ndarray, a: np.ndarray, since: np.ndarray) -> np.ndarray:
    """What the measured initial values of each part contribute to the free run."""
    order = a.shape[0]
    out = np.zeros(y.shape[0])
    for k in range(y.shape[0]):
        if since[k] < order:
            out[k] = y[k]
        else:
            for lag in range(order):
                out[k] += a[lag] * out[k - 1 - lag]
    return out
