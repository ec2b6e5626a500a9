"""Covariance of a network's parameters, honest where residuals hang together in time and differ in size.

The estimate solves (X'X + L) theta = X'y + ..., with X the sensitivities of the free run and L the penalties. Its
covariance is (X'X + L)^-1 (X' O X + k L) (X'X + L)^-1 with O the covariance of the residuals. k L stands for the
systematic error that the penalties bring: they act like a prior that held-out data chose, and intervals that take
them as one hold on average over the parameters, while the variance alone is too small (Wahba, J. Roy. Stat. Soc. B 45,
1983; Nychka, J. Am. Stat. Assoc. 83, 1988). k is the mean ratio of X' O X to X'X in the metric of X'X + L.
Penalties of a refined network were chosen before its poles were freed, and the pull towards the start coarsely: both
are weighed by how far the parameters went against them, one step of expectation and maximisation for the spread that
they stand for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve, qr
from threadpoolctl import threadpool_limits

from models.free_run import initial_samples, run_recursion, sensitivity_block
from models.local_model_network import blend
from models.partition import Partition
from models.regression import Dataset
from models.residual_correlation import ResidualCorrelation
from models.timeseries import FloatArray

_BLOCK = 8192
# Blocks beyond this many samples are left out evenly: they would tell the same, and the products cost N P^2.
_MOST_SAMPLES = 262_144
_RIDGE = 1e-10


@dataclass(frozen=True)
class ParameterCovariance:
    """Covariance F F' of P free parameters.

    Attributes
    ----------
    factor : (P, P) lower triangular F, normalised units
    n_shared : output coefficients that all local models share, the first of the free parameters; 0: none shared
    n_models, order : of the network
    data_share : (M,) how much of each local model is determined by its data rather than by the penalties, 0..1
    """

    factor: FloatArray
    n_shared: int
    n_models: int
    order: int
    data_share: FloatArray

    @property
    def theta_factor(self) -> FloatArray:
        """(M p, P) factor of the covariance of `theta.ravel()`."""
        if self.n_shared == 0:
            return self.factor
        return self.factor[free_index(self.n_models, self.order, len(self.factor), self.n_shared)]

    @property
    def covariance(self) -> FloatArray:
        """(M p, M p) covariance of `theta.ravel()`."""
        factor = self.theta_factor
        return factor @ factor.T


@dataclass(frozen=True)
class Pull:
    """A quadratic pull towards start values.

    Attributes
    ----------
    strength : (M p,) of each parameter
    away : (M p,) estimate minus start value
    """

    strength: FloatArray
    away: FloatArray


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
    penalty: FloatArray,
    pull: Pull | None = None,
) -> ParameterCovariance:
    """Covariance of the parameters of a fitted network.

    Parameters
    ----------
    theta : (M, p) the estimate
    order : output order
    partition, data : what it was fitted to
    level : (N,) standard deviation of the residual at each sample, normalised units
    correlation : of the residuals divided by their level
    penalty : (P, P) that was added to the information; over the input parameters of all local models without `pull`,
        else over all parameters
    pull : of the refinement towards its start; None: no refinement, all local models share their output coefficients
    """
    n_models, p = theta.shape
    n_shared = order if pull is None else 0
    with threadpool_limits(1, user_api="blas"):
        information, meat = _sums(theta, order, partition, data, level, correlation, n_shared)
        size = len(information)
        whole = np.zeros((size, size))
        whole[n_shared:, n_shared:] = penalty
        whole += _RIDGE * np.trace(information) / size * np.eye(size)
        against = np.zeros(size) if pull is None else pull.strength
        solved = cho_factor(information + whole + np.diag(against))
        data_part = np.diag(cho_solve(solved, information))
        scale = np.trace(cho_solve(solved, meat)) / max(float(data_part.sum()), 1e-300)
        meat += scale * whole
        if pull is not None:
            meat += _against(theta.ravel(), whole, pull, scale, cho_solve(solved, np.eye(size)))
        centre = _root(meat)
        factor = np.ascontiguousarray(np.asarray(qr(cho_solve(solved, centre).T, mode="r")[0]).T)
    own = data_part[n_shared:].reshape(n_models, -1)
    return ParameterCovariance(factor, n_shared, n_models, order, np.clip(own.mean(axis=1), 0.0, 1.0))


def _against(theta: FloatArray, penalty: FloatArray, pull: Pull, scale: float, inverse: FloatArray) -> FloatArray:
    """What a refined fit's penalties add beyond `scale`: they were chosen for shared poles, the pull coarsely."""
    spread = scale * inverse
    smooth = (theta @ penalty @ theta + np.sum(penalty * spread)) / np.linalg.matrix_rank(penalty)
    away = np.mean(pull.strength * (pull.away**2 + np.diag(spread)))
    return max(0.0, float(smooth) - scale) * penalty + max(scale, float(away)) * np.diag(pull.strength)


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
