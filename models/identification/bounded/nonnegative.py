"""Least squares with some coefficients not below zero, on the normal equations."""

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
class Solution:
    """A minimum of 1/2 x'Gx - h'x with x >= 0 where bounded.

    Attributes
    ----------
    x : (P,) coefficients
    free : (P,) bool, those that are not at their bound
    """

    x: FloatArray
    free: np.ndarray


def solve(information: FloatArray, right: FloatArray, bounded: np.ndarray, start: np.ndarray | None = None) -> Solution:
    """Find the minimum by block principal pivoting.

    Parameters
    ----------
    information : (P, P) symmetric, positive semidefinite
    right : (P,)
    bounded : (P,) bool, which coefficients must not be negative
    start : (P,) bool, the set of coefficients off their bounds to begin with; by default all

    Notes
    -----
    Judice and Pires, Computers and Operations Research 21, 1994; Kim and Park, SIAM J. Sci. Comput. 33, 2011. All
    coefficients that break their condition change sides at once; where that makes no progress for a few rounds, only
    the last one does, which cannot go round in circles.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information * np.outer(scale, scale)
    h = right * scale
    free = np.ones(len(h), dtype=bool) if start is None else (start | ~bounded)
    x, diagonal = np.zeros(len(h)), np.diag_indices_from(scaled)
    for ridge in _RIDGES:
        scaled[diagonal] = 1.0 + ridge
        x, free, done = _exchanged(scaled, h, bounded, free)
        if done:
            break
    return Solution(np.where(bounded, np.maximum(x, 0.0), x) * scale, free)


def _exchanged(
    scaled: FloatArray, h: FloatArray, bounded: np.ndarray, free: np.ndarray
) -> tuple[FloatArray, np.ndarray, bool]:
    """Coefficients, which are free, and whether all conditions hold."""
    tolerance = _TOLERANCE * max(float(np.abs(h).max(initial=0.0)), 1e-300)
    fewest, patience, x = len(h) + 1, _PATIENCE, np.zeros(len(h))
    for _ in range(_MOST_ROUNDS):
        x, slope = _of_set(scaled, h, free)
        wrong = bounded & ((free & (x < -tolerance)) | (~free & (slope < -tolerance)))
        count = int(wrong.sum())
        if count == 0:
            return x, free, True
        if count < fewest:
            fewest, patience = count, _PATIENCE
        elif patience > 0:
            patience -= 1
        else:
            last = int(np.flatnonzero(wrong)[-1])
            wrong[:] = False
            wrong[last] = True
        free = free ^ wrong
    return x, free, False


def _of_set(scaled: FloatArray, h: FloatArray, free: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Minimum with the others at zero, and the slope there."""
    own = np.flatnonzero(free)
    if not len(own):
        return np.zeros(len(h)), -h
    # Symmetric: its transpose is in LAPACK's order already.
    part = scaled.take(own, axis=0).take(own, axis=1)
    _, values, failed = _POSV(part.T, h[own])
    if failed:
        values = np.linalg.lstsq(part, h[own], rcond=None)[0]
    x = np.zeros(len(h))
    x[own] = values
    slope = scaled @ x - h
    slope[own] = 0.0
    return x, slope
