"""A run by the root of its covariance, and the sums that are kept of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from models.data.timeseries import FloatArray


@dataclass(frozen=True)
class White:
    """A run by the root of its covariance.

    Attributes
    ----------
    scale : of the error elsewhere
    lower : (N, N) that root
    error : (N,)
    columns : (N, COUNT)
    across : (N, n) covariance with the resistances
    """

    scale: float
    lower: FloatArray
    error: FloatArray
    columns: FloatArray
    across: FloatArray

    @cached_property
    def log(self) -> float:
        """Logarithm of the likelihood where nothing at all has changed."""
        return -float(np.sum(np.log(np.diag(self.lower)))) - 0.5 * float(self.error @ self.error)

    def with_other(self, error: FloatArray, slope: FloatArray) -> White:
        """With another error and another first column."""
        two = solve_triangular(self.lower, np.column_stack([error, slope]), lower=True, check_finite=False)
        return replace(self, error=two[:, 0], columns=np.column_stack([two[:, 1], self.columns[:, 1:]]))

    @cached_property
    def sums(self) -> Sums:
        """All that weights are found from."""
        columns, across = self.columns, self.across
        return Sums(
            self.scale,
            self.log,
            columns.T @ columns,
            columns.T @ self.error,
            across.T @ columns,
            across.T @ self.error,
            np.sum(across**2, axis=0),
        )


@dataclass(frozen=True)
class Sums:
    """Sums of products of a run by the root of its covariance.

    Attributes
    ----------
    scale, log : of the error elsewhere, and logarithm of the likelihood where nothing at all has changed
    inner, right : (COUNT, COUNT) of the columns with each other, (COUNT,) with the error
    across_columns, across_error, across : (n, COUNT), (n,), (n,) of the resistances with both, and with themselves
    """

    scale: float
    log: float
    inner: FloatArray
    right: FloatArray
    across_columns: FloatArray
    across_error: FloatArray
    across: FloatArray


@dataclass(frozen=True)
class Summed:
    """What is kept of a run about a capacity: no samples, so that hundreds of runs have room.

    Attributes
    ----------
    change : of the capacity
    mean_Ohm, known, open : (n,) of the resistances before, as in `Fresh`
    fresh_Ohm, usual_Ohm : as in `About`
    sums : one for each scale
    """

    change: float
    mean_Ohm: FloatArray
    known: FloatArray
    open: FloatArray
    fresh_Ohm: FloatArray
    usual_Ohm: float
    sums: tuple[Sums, ...]
