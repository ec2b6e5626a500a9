"""A run by the root of its covariance, and the sums that are kept of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from models.data.timeseries import FloatArray
from models.diagnosis.trend.weights.latent import COUNT, QUICK


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

    def with_told(self, told: Told) -> Sums:
        """The same with what another run tells of the weights, of the first of its errors."""
        inner, right = self.inner + told.inner, self.right + told.right[:, 0]
        return replace(self, log=self.log + float(told.log[0]), inner=inner, right=right)


@dataclass(frozen=True)
class Summed:
    """What is kept of a run about a capacity: no samples, so that hundreds of runs have room.

    Attributes
    ----------
    change : of the capacity
    mean_Ohm, known, open : (n,) of the resistances before, as in `Fresh`
    fresh_Ohm, usual_Ohm, typical_Ohm : as in `About`
    sums : one for each scale
    """

    change: float
    mean_Ohm: FloatArray
    known: FloatArray
    open: FloatArray
    fresh_Ohm: FloatArray
    usual_Ohm: float
    typical_Ohm: float
    sums: tuple[Sums, ...]

    def beside(self, other: Summed, spread: FloatArray) -> Summed:
        """The same with what another run tells, in which the weights are those of this one but for what is usual.

        Parameters
        ----------
        other : of the cell in the same state, about much the same capacity
        spread : (COUNT, COUNT) root of the covariance by which weights differ between two runs
        """
        turn = in_units_of(self.usual_Ohm, other.usual_Ohm)
        sums = []
        for own, its in zip(self.sums, other.sums, strict=True):
            sums.append(own.with_told(Told.of(its.inner, its.right[:, None], np.array([its.log]), turn, spread)))
        return replace(self, sums=tuple(sums))


@dataclass(frozen=True)
class Told:
    """What one run tells of the weights of another, all that is its own integrated out.

    Attributes
    ----------
    inner, right, log : (COUNT, COUNT), (COUNT, M), (M,) as in `Sums`, of each of M errors
    """

    inner: FloatArray
    right: FloatArray
    log: FloatArray

    @classmethod
    def of(cls, inner: FloatArray, right: FloatArray, log: FloatArray, turn: FloatArray, spread: FloatArray) -> Told:
        """Integrate out by how much the weights differ.

        Parameters
        ----------
        inner, right, log : of the run that tells
        turn : (COUNT,) its weights over those of the other in their units
        spread : (COUNT, COUNT) root of the covariance of the difference
        """
        inner, right = turn[:, None] * inner * turn, turn[:, None] * right
        across = spread.T @ inner
        factor = cho_factor(np.eye(len(inner)) + across @ spread, lower=True, check_finite=False)
        own = spread.T @ right
        solved = cho_solve(factor, np.column_stack([across, own]), check_finite=False)
        n = len(inner)
        gained = 0.5 * np.sum(own * solved[:, n:], axis=0) - np.sum(np.log(np.diag(factor[0])))
        return cls(inner - across.T @ solved[:, :n], right - across.T @ solved[:, n:], log + gained)


def in_units_of(usual_Ohm: float, other_Ohm: float) -> FloatArray:
    """(COUNT,) weights in units of another run's resistance, over the same in units of this one's."""
    out = np.ones(COUNT)
    out[QUICK] = usual_Ohm / other_Ohm
    return out
