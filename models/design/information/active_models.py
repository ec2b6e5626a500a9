"""Information where only some local models count at a sample, as with hats: sums and criteria over those alone.

With A the information of an experiment that touches the parameters S only, det(P + A) = det(P) det(C_SS) det(C_SS^-1 +
A_SS) with C = P^-1, and the block of (P + A)^-1 over S is (C_SS^-1 + A_SS)^-1: D-optimality and its gradient need no
matrix over all parameters, of which there are thousands, but for one inverse of the prior.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from models.data.timeseries import FloatArray
from models.design.information.criteria import d_optimality, log_det


def groups(first: np.ndarray) -> Iterator[tuple[int, np.ndarray | slice]]:
    """Each first active local model with the samples that have it.

    Parameters
    ----------
    first : (N,) the first of the local models that count at a sample
    """
    if len(first) and (first == first[0]).all():
        yield int(first[0]), slice(None)
        return
    order = np.argsort(first, kind="stable")
    cuts = np.flatnonzero(np.diff(first[order])) + 1
    for index in np.split(order, cuts):
        if len(index):
            yield int(first[index[0]]), index


def add_products(total: FloatArray, rows: FloatArray, first: np.ndarray, n_params: int, scale: float) -> None:
    """Add the sum over samples of the outer products of their sensitivities.

    Parameters
    ----------
    total : (P, P) over consecutive local models from number 0 on; added to
    rows : (N, K p) sensitivities to the K active local models; first : (N,) see `groups`
    n_params, scale : p, and a factor on the sum
    """
    for model, index in groups(first):
        own, at = rows[index], slice(model * n_params, model * n_params + rows.shape[1])
        total[at, at] += scale * (own.T @ own)


def spread_out(rows: FloatArray, first: np.ndarray, n_models: int, n_params: int) -> FloatArray:
    """(N, M p) sensitivities to all local models from those to the active ones."""
    if rows.shape[1] == n_models * n_params:
        return rows
    out = np.zeros((len(rows), n_models * n_params))
    for model, index in groups(first):
        out[index, model * n_params : model * n_params + rows.shape[1]] = rows[index]
    return out


def picked(rows: FloatArray, first: np.ndarray, width: int, n_params: int) -> FloatArray:
    """(N, width) entries of the active local models from (N, M p) ones."""
    if rows.shape[1] == width:
        return rows
    out = np.empty((len(rows), width))
    for model, index in groups(first):
        out[index] = rows[index, model * n_params : model * n_params + width]
    return out


def times_block(rows: FloatArray, first: np.ndarray, n_params: int, matrix: FloatArray, out: FloatArray) -> None:
    """Multiply each sample's sensitivities by the block of a symmetric matrix over its active local models.

    Parameters
    ----------
    rows, out : (N, K p); first : (N,) counted from the matrix' first local model
    """
    for model, index in groups(first):
        at = slice(model * n_params, model * n_params + rows.shape[1])
        out[index] = rows[index] @ matrix[at, at]


@dataclass
class MarginalPrior:
    """What is known beforehand of some of the parameters, whatever the others are.

    Attributes
    ----------
    information : (P, P) on all parameters; None: each is known to `std` by itself
    size, std : number of parameters, and see `information`
    """

    information: FloatArray | None
    size: int
    std: float
    _covariance: FloatArray | None = None
    _log_det: float = 0.0
    _known: dict[tuple[int, int], tuple[FloatArray, float]] = field(default_factory=dict)

    def d_optimality(self, added: FloatArray, begin: int) -> tuple[float, FloatArray]:
        """Log det of prior and added information over all parameters.

        Parameters
        ----------
        added : (S, S) information of the experiment on the parameters from number `begin` on

        Returns
        -------
        The value, and the lower Cholesky factor of the inverse of what the inverse has over the touched parameters.
        """
        prior, rest = self.part(begin, begin + len(added))
        value, factor = log_det(prior + added)
        return value + rest, factor

    def part(self, begin: int, end: int) -> tuple[FloatArray, float]:
        """Information on the parameters from `begin` to `end` whatever the others are, C_SS^-1, and what is left.

        The latter is log det(P) + log det(C_SS).
        """
        if self.information is None:
            left = self.size - (end - begin)
            return np.eye(end - begin) / self.std**2, -2.0 * left * float(np.log(self.std))
        if self._covariance is None:
            self._log_det, self._covariance = d_optimality(self.information)
        if (begin, end) not in self._known:
            block = self._covariance[begin:end, begin:end]
            value, inverse = d_optimality(block)
            self._known[begin, end] = inverse, self._log_det + value
        return self._known[begin, end]
