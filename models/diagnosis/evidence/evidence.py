"""What regressors explain of an error that the model's own uncertainty does not.

Generalised least squares: the error e of the diagnosed runs is X b + A d + noise, where A are the model's regressors
and d is what its parameters may be off, with the information that the training runs gave of them as prior. Minimising
over d weights every direction by how well the model knows it: what the training runs have determined may not be bent
to swallow a change, what they left open may.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.errors import ModelError
from models.data.timeseries import FloatArray

_FOLDS = 5
# Keeps collinear regressors of one effect solvable, relative to their size.
_RIDGE = 1e-6
# What the other blocks hardly show of a regressor is not to be judged by.
_HELD_OUT_RIDGE = 1e-3
_TINY = 1e-150
# What rounding leaves below zero where samples tell nothing of some coefficients, over their size: tried in turn.
_ROUNDING = (0.0, 1e-12, 1e-10, 1e-8)


@dataclass(frozen=True)
class Solution:
    """Coefficients of some regressors.

    Attributes
    ----------
    cost : remaining error with them, over all samples, V^2
    coefficients, covariance : (k,), (k, k) for a noise of 1 V^2
    """

    cost: float
    coefficients: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Evidence:
    """Error and model of the diagnosed runs.

    Attributes
    ----------
    error_V : (n,) measured minus simulated
    regressors : (n, p) of the model
    information : (p, p) that the training runs gave of its parameters, for a noise of 1 V^2
    blocks : (n,) number of the block in time that each sample lies in, from 0 on
    per_run : first column of the model and the one after the last that stand for one run alone, such as its start
    """

    error_V: FloatArray
    regressors: FloatArray
    information: FloatArray
    blocks: np.ndarray
    per_run: tuple[int, int] = (0, 0)

    def with_information(self, information: FloatArray) -> Evidence:
        """The same error with other information; products of the regressors are not made again."""
        found = replace(self, information=information)
        found.__dict__["_xx"] = self._xx
        return found

    def kept(self, chosen: np.ndarray) -> Evidence:
        """The samples for which (n,) `chosen` holds, with their share of what the training runs say."""
        blocks = np.unique(self.blocks[chosen], return_inverse=True)[1]
        information = float(np.mean(chosen)) * self.information
        return Evidence(self.error_V[chosen], self.regressors[chosen], information, blocks, self.per_run)

    @cached_property
    def _parts(self) -> list[np.ndarray]:
        fold = self.blocks % _FOLDS
        return [np.flatnonzero(fold == f) for f in range(_FOLDS)]

    @cached_property
    def _xx(self) -> list[FloatArray]:
        return [self.regressors[part].T @ self.regressors[part] for part in self._parts]

    @cached_property
    def _factor(self):  # noqa: ANN202
        return _factored(np.sum(self._xx, axis=0) + self.information)

    @cached_property
    def _fold_factors(self):  # noqa: ANN202
        total = np.sum(self._xx, axis=0) + self.information
        return [_factored(total - xx) for xx in self._xx]

    @cached_property
    def cost(self) -> float:
        """Remaining error with no effect, V^2."""
        return self.cost_of(self.error_V)

    def cost_of(self, error_V: FloatArray) -> float:
        """Remaining part of an error once the model's parameters have adapted, V^2."""
        right = self.regressors.T @ error_V
        return float(error_V @ error_V - right @ cho_solve(self._factor, right))

    @cached_property
    def null_errors_V(self) -> FloatArray:
        """(n,) error in each held-out fold with the model's parameters adapted to the others."""
        return self._held_out(np.zeros((len(self.error_V), 0)), self.error_V)

    def absorbed(self, error_V: FloatArray) -> FloatArray:
        """(n,) part of an error that the model's parameters take in."""
        return self.regressors @ cho_solve(self._factor, self.regressors.T @ error_V)

    def of_runs(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """(n,) part of (n,) errors that belongs to single runs, beside (n, k) regressors and all of the model."""
        solution = self.solve(x, y)
        left = y - x @ solution.coefficients
        whole = cho_solve(self._factor, self.regressors.T @ left)
        own = slice(*self.per_run)
        return self.regressors[:, own] @ whole[own]

    def reduced(self, z: FloatArray) -> FloatArray:
        """(k, k) products of (n, k) columns once the model's parameters have adapted to each."""
        right = self.regressors.T @ z
        return z.T @ z - right.T @ cho_solve(self._factor, right)

    def least_cost(self, x: FloatArray) -> float:
        """Remaining error with regressors, V^2."""
        return self.solve(x).cost

    def solve(self, x: FloatArray, target_V: FloatArray | None = None) -> Solution:
        """Fit regressors.

        Parameters
        ----------
        x : (n, k)
        target_V : (n,) error that they explain, where it is not the error itself (linearised about a value)
        """
        y = self.error_V if target_V is None else target_V
        if not x.shape[1]:
            return Solution(self.cost_of(y), np.zeros(0), np.zeros((0, 0)))
        size = np.sqrt((x * x).sum(axis=0))
        scale = np.where(size > _TINY, size, 1.0)
        z = x / scale
        right = self.regressors.T @ np.column_stack([z, y])
        solved = cho_solve(self._factor, right)
        inner = right.T @ solved
        zz = z.T @ z - inner[:-1, :-1] + _RIDGE * np.eye(z.shape[1])
        zy = z.T @ y - inner[:-1, -1]
        b = np.linalg.solve(zz, zy)
        cost = float(y @ y - inner[-1, -1] - 2.0 * b @ zy + b @ zz @ b)
        return Solution(cost, b / scale, np.linalg.inv(zz) / np.outer(scale, scale))

    def gains(self, x: FloatArray, target_V: FloatArray | None = None) -> FloatArray:
        """(n_blocks,) fall of the squared error in blocks that were held out, V^2."""
        y = self.error_V if target_V is None else target_V
        z = x / (np.sqrt((x * x).sum(axis=0)) + _TINY)
        losses = self.null_errors_V**2 - self._held_out(z, y) ** 2
        return np.bincount(self.blocks, weights=losses).astype(np.float64)

    def _held_out(self, z: FloatArray, y: FloatArray) -> FloatArray:
        a, out = self.regressors, np.empty(len(y))
        right = np.column_stack([z, y])
        parts = [a[part].T @ right[part] for part in self._parts]
        total, whole = np.sum(parts, axis=0), right.T @ right
        for part, own, factor in zip(self._parts, parts, self._fold_factors, strict=True):
            ar = total - own
            solved = cho_solve(factor, ar)
            rr = whole - right[part].T @ right[part] - ar.T @ solved
            k = z.shape[1]
            b = np.linalg.solve(rr[:k, :k] + _HELD_OUT_RIDGE * np.eye(k), rr[:k, k]) if k else np.zeros(0)
            d = solved[:, k] - solved[:, :k] @ b
            out[part] = y[part] - z[part] @ b - a[part] @ d
        return out


def _factored(matrix: FloatArray):  # noqa: ANN202
    """Cholesky factor of a matrix that is positive but for rounding.

    Raises
    ------
    ModelError
        It is not: the runs have numbers in them that no cell makes.
    """
    size = np.diag(matrix)
    if np.isfinite(matrix).all() and (size >= 0.0).all():
        for share in _ROUNDING:
            with contextlib.suppress(np.linalg.LinAlgError):
                return cho_factor(matrix + np.diag(share * size + share * float(size.mean())))
    raise ModelError(
        "diagnosis: the runs cannot be held against the model, their numbers are too far apart: look for outliers in "
        "current and temperature, and for runs without current"
    )
