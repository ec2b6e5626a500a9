"""Covariance of a network's parameters, honest where residuals hang together in time and differ in size.

The estimate solves (X'X + L) theta = X'y + ..., with X the sensitivities of the free run and L the penalties. Its
covariance is (X'X + L)^-1 (X' O X + k L) (X'X + L)^-1 with O the covariance of the residuals. k L stands for the
systematic error that the penalties bring: they act like a prior that held-out data chose, and intervals that take
them as one hold on average over the parameters, while the variance alone is too small (Wahba, J. Roy. Stat. Soc. B 45,
1983; Nychka, J. Am. Stat. Assoc. 83, 1988). k is the mean ratio of X' O X to X'X in the metric of X'X + L. Held-out
data choose strengths only roughly, and for where they extrapolate: where an estimate with a penalty all but taken away
goes further against it than k tells, that penalty counts with the spread that it was found to stand for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve, qr
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray
from models.network.partition import Partition
from models.network.penalty import Penalty
from models.network.recursion import blend, initial_samples, run_recursion, sensitivity_block
from models.network.regression import Dataset
from models.uncertainty.correlation import ResidualCorrelation
from models.uncertainty.expansion import Expansion

_BLOCK = 8192
# Blocks beyond this many samples are left out evenly: they would tell the same, and the products cost N P^2.
_MOST_SAMPLES = 262_144
_RIDGE = 1e-10
# Shares to which a penalty is weakened to see what it hides.
_WEAKENED = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)


@dataclass(frozen=True)
class ParameterCovariance:
    """Covariance F F' of P free parameters.

    Attributes
    ----------
    factor : (P, P) lower triangular F, normalised units
    n_shared : output coefficients that all local models share, the first of the free parameters; 0: none shared
    n_models, order : of the network
    data_share : (M,) how much of each local model is determined by its data rather than by the penalties, 0..1
    expansion : of parameters that are free at some knots only; None: each local model has its own
    """

    factor: FloatArray
    n_shared: int
    n_models: int
    order: int
    data_share: FloatArray
    expansion: Expansion | None = None

    @property
    def theta_factor(self) -> FloatArray:
        """(M p, P) factor of the covariance of `theta.ravel()`."""
        if self.expansion is not None:
            return self.expansion.matrix() @ self.factor
        if self.n_shared == 0:
            return self.factor
        return self.factor[free_index(self.n_models, self.order, len(self.factor), self.n_shared)]

    @property
    def covariance(self) -> FloatArray:
        """(M p, M p) covariance of `theta.ravel()`."""
        factor = self.theta_factor
        return factor @ factor.T


def free_index(n_models: int, order: int, n_free: int, n_shared: int) -> np.ndarray:
    """(M p,) which free parameter each entry of `theta.ravel()` is."""
    q = (n_free - n_shared) // n_models
    own = n_shared + np.arange(n_models * q).reshape(n_models, q)
    return np.hstack([np.tile(np.arange(order), (n_models, 1)), own]).ravel()


def parameter_covariance(
    theta: FloatArray,
    order: int,
    partition: Partition,
    data: Dataset,
    *,
    level: FloatArray,
    correlation: ResidualCorrelation,
    penalties: list[Penalty],
    shared: bool = True,
) -> ParameterCovariance:
    """Covariance of the parameters of a fitted network.

    Parameters
    ----------
    theta : (M, p) the estimate
    order : output order
    partition, data : what it was fitted to
    level : (N,) standard deviation of the residual at each sample, normalised units
    correlation : of the residuals divided by their level
    penalties : over the input parameters of all local models where they share their output coefficients, else over all
        parameters
    shared : whether they do
    """
    n_models, p = theta.shape
    n_shared = order if shared else 0
    with threadpool_limits(1, user_api="blas"):
        information, meat = _sums(theta, order, partition, data, level, correlation, n_shared)
        size = len(information)
        ridge = _RIDGE * np.trace(information) / size * np.eye(size)
        whole = ridge.copy()
        whole[n_shared:, n_shared:] += np.sum([penalty.matrix for penalty in penalties], axis=0)
        solved = cho_factor(information + whole)
        data_part = np.diag(cho_solve(solved, information))
        scale = np.trace(cho_solve(solved, meat)) / max(float(data_part.sum()), 1e-300)
        own = [_over_all(penalty, size) for penalty in penalties]
        spread = [max(scale, _spread(penalty, information + whole, meat, scale)) for penalty in own]
        meat += scale * ridge + np.sum([k * each.matrix for k, each in zip(spread, own, strict=True)], axis=0)
        centre = _root(meat)
        factor = np.ascontiguousarray(np.asarray(qr(cho_solve(solved, centre).T, mode="r")[0]).T)
    determined = data_part[n_shared:].reshape(n_models, -1)
    return ParameterCovariance(factor, n_shared, n_models, order, np.clip(determined.mean(axis=1), 0.0, 1.0))


def _spread(penalty: Penalty, regular: FloatArray, meat: FloatArray, scale: float) -> float:
    """Variance of the parameters' differences that a penalty stands for, found where it is all but taken away.

    The penalised estimate has itself been pulled; one with the penalty weakened is less so, and its own variance is
    known. The penalty is weakened as far as that variance stays below what the penalty takes for granted.
    """
    rank = int(np.linalg.matrix_rank(penalty.matrix, hermitian=True))
    if rank == 0:
        return 0.0
    push = penalty.matrix @ penalty.apart
    for share in _WEAKENED:
        solved = cho_factor(regular - (1.0 - share) * penalty.matrix)
        noise = float(np.sum(cho_solve(solved, penalty.matrix) * cho_solve(solved, meat).T))
        if share == _WEAKENED[-1] or noise < rank * scale:
            apart = penalty.apart + (1.0 - share) * cho_solve(solved, push)
            return (float(apart @ penalty.matrix @ apart) - noise) / rank
    return 0.0


def _over_all(penalty: Penalty, size: int) -> Penalty:
    """A penalty on the last parameters as one on all; shared output coefficients are the first and free of it."""
    matrix, apart, n = np.zeros((size, size)), np.zeros(size), len(penalty.apart)
    matrix[size - n :, size - n :], apart[size - n :] = penalty.matrix, penalty.apart
    return Penalty(matrix, apart)


def _root(matrix: FloatArray) -> FloatArray:
    """Factor G of a positive semidefinite matrix G G'."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def _sums(
    theta: FloatArray,
    order: int,
    partition: Partition,
    data: Dataset,
    level: FloatArray,
    correlation: ResidualCorrelation,
    n_shared: int,
) -> tuple[FloatArray, FloatArray]:
    """X'X and X' O X, block by block.

    With autocorrelation r^|k-l| and M(k) = r M(k-1) + X(k), sum over all pairs of samples is M'X + X'M - X'X: one
    forward pass and one product for any number of fading parts.
    """
    validity = partition.validity(data.z)
    a, f = blend(theta, order, validity, data)
    y_sim = run_recursion(a, f, data.y, data.starts)
    is_start = initial_samples(len(data), data.starts, order)
    unusable = np.isnan(data.y) | (is_start > 0)
    size = theta.size if n_shared == 0 else n_shared + theta.size - order * len(theta)
    information, meat = np.zeros((size, size)), np.zeros((size, size))
    carry, rows = np.zeros((max(order, 1), theta.size)), np.empty((_BLOCK, theta.size))
    keep_every = -(-len(data) // _MOST_SAMPLES)
    state, last_block = np.zeros((len(correlation.keep), size)), -1
    is_first = np.zeros(len(data), dtype=np.uint8)
    is_first[data.starts] = 1
    for number, first in enumerate(range(0, len(data), _BLOCK)):
        skipped = number % keep_every != 0
        if skipped and order == 0:
            continue
        part = slice(first, min(first + _BLOCK, len(data)))
        block = rows[: part.stop - first]
        sensitivity_block(first, validity, data.u, y_sim, a, is_start, carry, block)
        if skipped:
            continue
        x = np.ascontiguousarray(_free(block, len(theta), order) if n_shared else block)
        x[unusable[part]] = 0.0
        if last_block != number - 1:
            state[:] = 0.0
        last_block = number
        information += x.T @ x
        scaled = x * level[part, None]
        paired = np.empty_like(x)
        _paired_rows(scaled, is_first[part], correlation.white, correlation.shares, correlation.keep, state, out=paired)
        meat += scaled.T @ paired
    return keep_every * information, keep_every * 0.5 * (meat + meat.T)


class PairedProducts:
    """X'OX of one run with O the correlation of its errors, block of samples by block.

    Parameters
    ----------
    correlation : of the errors; rows of X are multiplied by their standard deviations before
    size : number of columns of X
    """

    def __init__(self, correlation: ResidualCorrelation, size: int) -> None:
        self._correlation = correlation
        self._total, self._state = np.zeros((size, size)), np.zeros((len(correlation.keep), size))

    def add(self, rows: FloatArray) -> None:
        """Add the (n, size) rows that follow those before."""
        memory, paired = self._correlation, np.empty_like(rows)
        goes_on = np.zeros(len(rows), dtype=np.uint8)
        _paired_rows(rows, goes_on, memory.white, memory.shares, memory.keep, self._state, paired)
        self._total += rows.T @ paired

    def total(self) -> FloatArray:
        """(size, size) so far."""
        return 0.5 * (self._total + self._total.T)


def _free(rows: FloatArray, n_models: int, order: int) -> FloatArray:
    """Sensitivities to shared output coefficients and own input parameters."""
    own = rows.reshape(len(rows), n_models, -1)
    return np.hstack([own[:, :, :order].sum(axis=1), own[:, :, order:].reshape(len(rows), -1)])


@njit(cache=True)
def _paired_rows(
    rows: np.ndarray,
    is_first: np.ndarray,
    white: float,
    shares: np.ndarray,
    keep: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
) -> None:
    """W with sym(X'W) = X' O X: white X + sum_j share_j (2 M_j - X); `state` (J, P) holds M_j of the last row."""
    for k in range(rows.shape[0]):
        for c in range(rows.shape[1]):
            out[k, c] = white * rows[k, c]
        for j in range(keep.shape[0]):
            for c in range(rows.shape[1]):
                fade = 0.0 if is_first[k] else keep[j] * state[j, c]
                state[j, c] = fade + rows[k, c]
                out[k, c] += shares[j] * (2.0 * state[j, c] - rows[k, c])
