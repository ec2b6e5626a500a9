"""Where training runs begin: what nobody knows of it is found with the cell that is fitted to them.

A state of charge that is half a point off, or a log that begins in a relaxation, would else bend the cell, and what is
left of it would pass for an error of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.scaled import solve_scaled
from models.diagnosis.known.start import start_columns
from models.diagnosis.known.thresholds import KNOWN
from models.effects.view import View
from models.identification.bounded.problem import summed_beyond

_BLOCK = 4096
# Of the largest information, with which coefficients that no sample speaks of stay where they are.
_RIDGE = 1e-13


@dataclass(frozen=True)
class TrainingStarts:
    """What the starts of training runs make of their voltage.

    Attributes
    ----------
    every : (n, k) V of one standard deviation of each unknown state, of each run
    sizes : (K,) likeliest states of all runs, one after the other
    covariance : (K, K) of what is left open of them
    soc_std : standard deviation that the stated states of charge were taken to have
    follow : (P, K) by how much the cell's coefficients follow, all of them free, in V, the curve by its values
    """

    every: list[FloatArray]
    sizes: FloatArray
    covariance: FloatArray
    soc_std: float
    follow: FloatArray

    @property
    def volts(self) -> list[FloatArray]:
        """(n,) V of each run."""
        return [each @ own for each, own in zip(self.every, np.split(self.sizes, self._edges[1:-1]), strict=True)]

    @property
    def soc_shifts(self) -> tuple[FloatArray, FloatArray]:
        """(R,) by how much each run's state of charge lies above the stated one, and the standard deviation of that."""
        first = self._edges[:-1]
        return self.soc_std * self.sizes[first], self.soc_std * np.sqrt(np.diag(self.covariance)[first])

    @property
    def _edges(self) -> np.ndarray:
        """(R + 1,) place of each run's first state, that of charge; the last: number of all."""
        return np.cumsum([0, *(each.shape[1] for each in self.every)])

    def open_V2(self, run: np.ndarray, index: np.ndarray, rows: FloatArray) -> FloatArray:
        """(m, m) covariance, at points of the runs, of what is left open, the cell's coefficients following.

        Parameters
        ----------
        run, index : (m,) which run and sample
        rows : (m, P) derivatives of the voltage to the coefficients there
        """
        columns = self.columns(run, index) + rows @ self.follow
        return columns @ self.covariance @ columns.T

    def columns(self, run: np.ndarray, index: np.ndarray) -> FloatArray:
        """(m, K) V of one standard deviation of each unknown state at points of the runs, one run after the other."""
        return np.asarray(block_diag(*(each[index[run == r]] for r, each in enumerate(self.every))))

    @property
    def of_coefficients_V2(self) -> FloatArray:
        """(P, P) covariance of the cell's coefficients by what is left open of the starts."""
        return self.follow @ self.covariance @ self.follow.T


@dataclass(frozen=True)
class Fitted:
    """A cell with the samples that it was fitted to.

    Attributes
    ----------
    cell : fitted
    free : (P,) coefficients that are not at a bound, the curve given by its first value and its increments
    information : (P, P) mean square that each pair of coefficients makes, and their penalty, in V^2
    kept : (m,) samples of each run that it was fitted to
    taken_V : (n,) what had been taken off the measured voltage of each run
    error_V2 : mean squared error over how many independent samples there are
    """

    cell: KnownCell
    free: np.ndarray
    information: FloatArray
    kept: list[np.ndarray]
    taken_V: list[FloatArray]
    error_V2: float


def training_starts(
    fitted: Fitted, runs: list[GridRun], soc: list[float], soc_std: float = KNOWN.start_soc
) -> TrainingStarts:
    """Likeliest starts, the cell's coefficients free to follow but for those at a bound.

    Parameters
    ----------
    fitted : cell to begin with
    runs, soc : as measured, on one grid, with their stated SoC at the start
    soc_std : how far off that may be

    Notes
    -----
    Variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973.
    """
    cell, own = fitted.cell, np.flatnonzero(fitted.free)
    views = [View(cell, run, s, np.arange(len(run))) for run, s in zip(runs, soc, strict=True)]
    every = [_open(start) * start_columns(cell, view, soc_std) for view, start in zip(views, soc, strict=True)]
    size, count = sum(each.shape[1] for each in every), sum(len(kept) for kept in fitted.kept)
    across, down = np.zeros((len(fitted.information), size)), np.zeros(len(own))
    inner, asked = np.zeros((size, size)), np.zeros(size)
    first = 0
    for run, start, kept, taken_V, columns in zip(runs, soc, fitted.kept, fitted.taken_V, every, strict=True):
        part = slice(first, first + columns.shape[1])
        for at in range(0, len(kept), _BLOCK):
            view = View(cell, run, start, kept[at : at + _BLOCK])
            rows, begun = _by_increments(cell, view), columns[view.index]
            across[:, part] += rows.T @ begun / count
            down += rows[:, own].T @ taken_V[view.index] / count
            inner[part, part] += begun.T @ begun / count
            asked[part] += begun.T @ view.residual_V / count
        first = part.stop
    held, free = across[own], fitted.information[np.ix_(own, own)]
    factor = cho_factor(free + _RIDGE * free.max(initial=0.0) * np.eye(len(own)))
    inner = inner - held.T @ cho_solve(factor, held) + fitted.error_V2 * np.eye(size)
    solved = np.linalg.inv(0.5 * (inner + inner.T))
    sizes = solved @ (asked - held.T @ cho_solve(factor, down))
    follow, n = -solve_scaled(fitted.information, across), cell.layout.n_curve
    follow[:n] = np.cumsum(follow[:n], axis=0)
    return TrainingStarts(every, sizes, fitted.error_V2 * solved, soc_std, follow)


def _open(soc: float) -> float:
    """0 where a run is said to begin full or empty: that is what the cell's voltage said, not what somebody counted.

    Cycles all begin there alike, and what is alike in all of them is the cell's own.
    """
    return float(KNOWN.start_soc < soc < 1.0 - KNOWN.start_soc)


def _by_increments(cell: KnownCell, view: View) -> FloatArray:
    """(m, P) derivatives of the voltage to the coefficients, the curve given by its first value and its increments."""
    rows, n = cell.regressors(view.inputs, view.soc[view.index]), cell.layout.n_curve
    rows[:, :n] = summed_beyond(rows[:, :n])
    return rows
