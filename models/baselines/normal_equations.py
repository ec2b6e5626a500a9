"""Least squares over tables: each term of the voltage is a signal times a table over state of charge and temperature.

A sample touches at most four values of each table, so its products are few; they are summed for each fold, and leaving
a fold out costs one subtraction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve

from models.baselines.tables import Axis
from models.data.timeseries import FloatArray

# Keeps directions that neither data nor smoothness reach solvable; far below any information in the data.
_RIDGE = 1e-11
_MAX_EXCHANGES = 200


@dataclass(frozen=True)
class Term:
    """One table and the signal that it is multiplied with.

    Attributes
    ----------
    signal : (N,)
    soc, temperature : where each sample lies between the table's knots
    is_ocv : whether the table is the open-circuit voltage
    """

    signal: FloatArray
    soc: Axis
    temperature: Axis
    is_ocv: bool = False

    @property
    def size(self) -> int:
        """Number of values in the table."""
        return self.soc.size * self.temperature.size


@dataclass(frozen=True)
class Sums:
    """Products of all table columns and the output, for each fold.

    Attributes
    ----------
    xx : (F, P, P); xy : (F, P); yy : (F,); count : (F,) samples
    """

    xx: FloatArray
    xy: FloatArray
    yy: FloatArray
    count: FloatArray

    def chosen(self, columns: np.ndarray) -> Sums:
        """Sums of some columns only."""
        return Sums(self.xx[:, columns[:, None], columns], self.xy[:, columns], self.yy, self.count)


class _Columns(NamedTuple):
    """Terms as the compiled loop reads them."""

    signal: np.ndarray  # (N, n) of each term
    cells: np.ndarray  # (N, n, 2) knot below each sample, in state of charge and temperature
    fractions: np.ndarray  # (N, n, 2) way to the next knot
    widths: np.ndarray  # (n,) knots in temperature
    first: np.ndarray  # (n + 1,) first column of each term


def offsets(terms: list[Term]) -> np.ndarray:
    """(n + 1,) first column of each term and the number of all columns."""
    return np.concatenate([[0], np.cumsum([term.size for term in terms])]).astype(np.int64)


def accumulate(terms: list[Term], y: FloatArray, fold: np.ndarray, n_folds: int) -> Sums:
    """Sum the products.

    Parameters
    ----------
    terms : columns in order
    y : (N,) output
    fold : (N,) fold of each sample, -1 where it does not count
    """
    first = offsets(terms)
    size = int(first[-1])
    sums = Sums(np.zeros((n_folds, size, size)), np.zeros((n_folds, size)), np.zeros(n_folds), np.zeros(n_folds))
    signal = np.ascontiguousarray(np.stack([term.signal for term in terms], axis=1))
    cells = np.stack([np.stack([t.soc.cell, t.temperature.cell], axis=1) for t in terms], axis=1)
    fractions = np.stack([np.stack([t.soc.fraction, t.temperature.fraction], axis=1) for t in terms], axis=1)
    widths = np.array([term.temperature.size for term in terms])
    _accumulate(_Columns(signal, cells, fractions, widths, first), y, fold, (sums.xx, sums.xy, sums.yy, sums.count))
    lower = np.tril(np.ones((size, size)), -1).astype(bool)
    for xx in sums.xx:
        xx.T[lower] = xx[lower]
    return sums


def solve(information: FloatArray, right: FloatArray) -> FloatArray:
    """Unconstrained minimum of x'Ax - 2 b'x."""
    return cho_solve(cho_factor(_regular(information)), right)


def solve_bounded(information: FloatArray, right: FloatArray, bounded: np.ndarray) -> FloatArray:
    """Minimum of x'Ax - 2 b'x with x >= 0 where `bounded`.

    Notes
    -----
    Block principal pivoting (Portugal, Judice and Vicente, Math. Comp. 63, 1994): sets of variables are exchanged
    between "free" and "at zero" until none is negative and no gradient at zero points inwards; where a round does not
    lower the number of offenders, only the last of them is exchanged, which ends in any case.
    """
    regular = _regular(information)
    free = np.ones(len(right), dtype=bool)
    fewest, patience = len(right) + 1, 3
    x = np.zeros(len(right))
    for _ in range(_MAX_EXCHANGES):
        x = np.zeros(len(right))
        x[free] = cho_solve(cho_factor(regular[np.ix_(free, free)]), right[free])
        gradient = regular @ x - right
        scale = 1e-9 * max(float(np.abs(right).max()), 1e-300)
        offending = bounded & ((free & (x < -1e-12)) | (~free & (gradient < -scale)))
        count = int(offending.sum())
        if count == 0:
            break
        if count < fewest:
            fewest, patience = count, 3
        elif patience > 0:
            patience -= 1
        else:
            offending = np.arange(len(right)) == int(np.flatnonzero(offending)[-1])
        free ^= offending
    return np.where(bounded, np.maximum(x, 0.0), x)


def _regular(information: FloatArray) -> FloatArray:
    size = len(information)
    return information + (_RIDGE * np.trace(information) / size) * np.eye(size)


@njit(cache=True)
def _accumulate(columns: _Columns, y: np.ndarray, fold: np.ndarray, sums: tuple[np.ndarray, ...]) -> None:
    # Taken out of the tuples once: each access counts a reference.
    signal, cells, fractions, widths, first = columns
    xx, xy, yy, count = sums
    n_terms = signal.shape[1]
    column, value = np.empty(4 * n_terms, dtype=np.int64), np.empty(4 * n_terms)
    for k in range(signal.shape[0]):
        if fold[k] < 0:
            continue
        m = 0
        for t in range(n_terms):
            s = signal[k, t]
            if s == 0.0:
                continue
            f, g = fractions[k, t, 0], fractions[k, t, 1]
            corner = first[t] + cells[k, t, 0] * widths[t] + cells[k, t, 1]
            for below in range(2):
                along = s * (f if below else 1.0 - f)
                for right in range(2):
                    weight = along * (g if right else 1.0 - g)
                    # Columns rise with each step, so the products fill the lower triangle only.
                    if weight != 0.0:
                        column[m], value[m] = corner + below * widths[t] + right, weight
                        m += 1
        part = fold[k]
        for p in range(m):
            for q in range(p + 1):
                xx[part, column[p], column[q]] += value[p] * value[q]
            xy[part, column[p]] += value[p] * y[k]
        yy[part] += y[k] * y[k]
        count[part] += 1.0
