"""Least squares with coefficients between bounds, on the normal equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import get_lapack_funcs

from models.data.timeseries import FloatArray

# Rounds of exchanging all at once without progress, before one is exchanged at a time, which ends where no two sets are
# equally good to rounding.
_PATIENCE = 4
_MOST_ROUNDS = 60
# Relative to the unit diagonal of the scaled equations. Where regressors are all but alike, the exchange can go round
# in circles over differences of rounding; a larger ridge then tells them apart.
_RIDGES = (1e-10, 1e-8, 1e-6, 1e-4)
_TOLERANCE = 1e-9
# Straight to LAPACK: what SciPy asks about its arguments takes longer than the few dozen equations.
(_POSV,) = get_lapack_funcs(("posv",), (np.zeros(0),))


@dataclass(frozen=True)
class Box:
    """What coefficients must lie between.

    Attributes
    ----------
    lower, upper : (P,) bounds, lower < upper; infinite where there is none
    """

    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True)
class Solution:
    """A minimum of 1/2 x'Gx - h'x in a box.

    Attributes
    ----------
    x : (P,) coefficients
    side : (P,) int, -1 at the lower bound, 1 at the upper one, 0 off its bounds
    """

    x: FloatArray
    side: np.ndarray

    @property
    def free(self) -> np.ndarray:
        """(P,) bool, those that are not at a bound."""
        return self.side == 0


def solve(information: FloatArray, right: FloatArray, box: Box, start: np.ndarray | None = None) -> Solution:
    """Find the minimum by block principal pivoting.

    Parameters
    ----------
    information : (P, P) symmetric, positive semidefinite
    right : (P,)
    box : of the coefficients
    start : (P,) int, sides as a solution has them, to begin with; by default none at a bound

    Notes
    -----
    Judice and Pires, Computers and Operations Research 21, 1994; Kim and Park, SIAM J. Sci. Comput. 33, 2011. All
    coefficients that break their condition change sides at once; where that makes no progress for a few rounds, only
    the last one does, which cannot go round in circles.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information * np.outer(scale, scale)
    h = right * scale
    own = Box(box.lower / scale, box.upper / scale)
    side = np.zeros(len(h), dtype=np.int8) if start is None else _allowed(start, box)
    x, diagonal = np.zeros(len(h)), np.diag_indices_from(scaled)
    for ridge in _RIDGES:
        scaled[diagonal] = 1.0 + ridge
        x, side, done = _exchanged(scaled, h, own, side)
        if done:
            break
    x = np.where(side < 0, box.lower, np.where(side > 0, box.upper, np.clip(x * scale, box.lower, box.upper)))
    return Solution(x, side)


def _allowed(side: np.ndarray, box: Box) -> np.ndarray:
    """The same sides where there is a bound, 0 elsewhere."""
    there = np.where(side < 0, np.isfinite(box.lower), np.where(side > 0, np.isfinite(box.upper), False))
    return np.where(there, side, 0).astype(np.int8)


def _exchanged(scaled: FloatArray, h: FloatArray, box: Box, side: np.ndarray) -> tuple[FloatArray, np.ndarray, bool]:
    """Coefficients, at which bounds they are, and whether all conditions hold."""
    tolerance = _TOLERANCE * max(float(np.abs(h).max(initial=0.0)), 1e-300)
    fewest, patience, x = len(h) + 1, _PATIENCE, np.zeros(len(h))
    for _ in range(_MOST_ROUNDS):
        x, slope = _of_set(scaled, h, box, side)
        # Beyond a bound: to it. At a bound, while the minimum lies inside: off it.
        below, above = (side == 0) & (x < box.lower - tolerance), (side == 0) & (x > box.upper + tolerance)
        wrong = below | above | (side * slope > tolerance)
        count = int(wrong.sum())
        if count == 0:
            return x, side, True
        if count < fewest:
            fewest, patience = count, _PATIENCE
        elif patience > 0:
            patience -= 1
        else:
            last = int(np.flatnonzero(wrong)[-1])
            wrong[:] = False
            wrong[last] = True
        side = np.where(wrong, above.astype(np.int8) - below.astype(np.int8), side)
    return x, side, False


def _of_set(scaled: FloatArray, h: FloatArray, box: Box, side: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Minimum with the others at their bounds, and the slope there."""
    own, x = np.flatnonzero(side == 0), np.zeros(len(h))
    x[side < 0], x[side > 0] = box.lower[side < 0], box.upper[side > 0]
    if not len(own):
        return x, scaled @ x - h
    right = h[own] - (scaled[own] @ x if x.any() else 0.0)
    # Symmetric: its transpose is in LAPACK's order already.
    part = scaled.take(own, axis=0).take(own, axis=1)
    _, values, failed = _POSV(part.T, right)
    if failed:
        values = np.linalg.lstsq(part, right, rcond=None)[0]
    x[own] = values
    slope = scaled @ x - h
    slope[own] = 0.0
    return x, slope
