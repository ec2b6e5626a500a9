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
from scipy.linalg import cho_factor, cho_solve

from models.free_run import samples_since_start
from models.holdout import folds
from models.partition import Partition
from models.regression import Dataset
from models.structure import Structure
from models.timeseries import FloatArray

_BLOCK = 4096
# Keeps directions that no sample excites solvable; far below any information in the data.
_RIDGE = 1e-10
# Range and steps, in powers of ten, of the penalties' strengths relative to the mean squared output.
_STRENGTH = (-10.0, 1.0)
_STEPS = (1.0, 0.5)
_FIRST_LEVELS = (-7.0, -5.0, -3.0)


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
    target = data.y - _initial_response(np.nan_to_num(data.y), a, since)
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
    forms: list[FloatArray] = [np.zeros((n_models * q, n_models * q)) for _ in range(4)]
    for i, j in partition.neighbours():
        along_soc = _shared_axis(partition, i, j) == soc_axis
        probes = np.array(_probes(partition, i, j, soc_axis, along_soc))
        rows = np.zeros((len(probes), q))
        rows[:, q - 1] = gain
        rows[:, line] = gain * probes[:, None]
        _add_difference(forms[0 if along_soc else 1], i, j, rows.T @ rows)
        apart = np.zeros(q)
        apart[other] = (gain * scale[other]) ** 2
        _add_difference(forms[2 if along_soc else 3], i, j, np.diag(apart))
    return forms


def _add_difference(form: FloatArray, i: int, j: int, block: FloatArray) -> None:
    """Add the quadratic form `block` of the difference between the parameters of two local models."""
    q = len(block)
    first, second = slice(i * q, (i + 1) * q), slice(j * q, (j + 1) * q)
    form[first, first] += block
    form[second, second] += block
    form[first, second] -= block
    form[second, first] -= block


def fit(sums: Moments, forms: list[FloatArray], start: tuple[float, ...] | None = None) -> SharedPoleFit:
    """Choose the penalties' strengths on held-out groups, then fit all groups.

    Parameters
    ----------
    sums : moments of each group
    forms : penalties
    start : strengths that served a similar candidate: only these, all weaker and all stronger are tried, which will do
        to compare candidates
    """
    judge = _Judge.of(sums, forms)
    if start is not None:
        best, strengths = min((judge.error(level), level) for level in _near(list(start)))
    else:
        best, strengths = min((judge.error(level), level) for level in [[v] * len(forms) for v in _FIRST_LEVELS])
        best, strengths = _descend(judge, best, strengths)
    penalty = _weighted(forms, strengths) * sums.count.sum()
    b = _solve(judge.xx + penalty, judge.xy)
    return SharedPoleFit(b, tuple(strengths), best, penalty)


def solve_without(sums: Moments, penalty: FloatArray, held: np.ndarray) -> FloatArray:
    """Parameters fitted to all groups but those in `held`, with the penalty in proportion."""
    kept = np.setdiff1d(np.arange(len(sums.count)), held)
    share = sums.count[kept].sum() / max(sums.count.sum(), 1.0)
    return _solve(sums.xx[kept].sum(axis=0) + share * penalty, sums.xy[kept].sum(axis=0))


def _near(start: list[float]) -> list[list[float]]:
    low, high = _STRENGTH
    return [[min(max(v + shift, low), high) for v in start] for shift in (0.0, -1.0, 1.0)]


def _descend(judge: _Judge, best: float, strengths: list[float]) -> tuple[float, list[float]]:
    """One strength after the other, with finer steps in the second round."""
    for step in _STEPS:
        for i in range(len(strengths)):
            for signed in (step, -step):
                while _STRENGTH[0] <= strengths[i] + signed <= _STRENGTH[1]:
                    trial = [*strengths[:i], strengths[i] + signed, *strengths[i + 1 :]]
                    error = judge.error(trial)
                    if not error < best * (1.0 - 1e-4):
                        break
                    best, strengths = error, trial
    return best, strengths


def _weighted(forms: list[FloatArray], log_strengths: list[float]) -> FloatArray:
    return np.sum([10.0**s * form for s, form in zip(log_strengths, forms, strict=True)], axis=0)


@dataclass(frozen=True)
class _Judge:
    """Held-out error of any strengths; sums over all groups and over each fold are made once."""

    forms: list[FloatArray]
    xx: FloatArray
    xy: FloatArray
    count: float
    folds: list[tuple[FloatArray, FloatArray, float, float]]

    @classmethod
    def of(cls, sums: Moments, forms: list[FloatArray]) -> _Judge:
        parts = [
            (sums.xx[f].sum(axis=0), sums.xy[f].sum(axis=0), float(sums.yy[f].sum()), float(sums.count[f].sum()))
            for f in folds(len(sums.count))
        ]
        return cls(forms, sums.xx.sum(axis=0), sums.xy.sum(axis=0), float(sums.count.sum()), parts)

    def error(self, log_strengths: list[float]) -> float:
        """Mean squared error over all held-out groups."""
        penalty = _weighted(self.forms, log_strengths)
        total, judged = 0.0, 0.0
        for xx, xy, yy, count in self.folds:
            b = _solve(self.xx - xx + (self.count - count) * penalty, self.xy - xy)
            total += max(float(yy - 2.0 * b @ xy + b @ xx @ b), 0.0)
            judged += count
        return total / max(judged, 1.0)


def _solve(information: FloatArray, right: FloatArray) -> FloatArray:
    size = len(information)
    ridge = _RIDGE * np.trace(information) / size
    regular = information + ridge * np.eye(size)
    try:
        return cho_solve(cho_factor(regular), right)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(regular, right, rcond=None)[0]


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
def _initial_response(y: np.ndarray, a: np.ndarray, since: np.ndarray) -> np.ndarray:
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
