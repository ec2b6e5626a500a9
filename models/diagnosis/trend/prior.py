"""What a run is expected to be about the fresh cell's model, linear about one capacity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.elsewhere import Points, points_of
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.start import start_columns
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.trend.ends import Ends
from models.diagnosis.trend.quick import Steps, quick_rows, step_points
from models.diagnosis.trend.settings import SETTINGS
from models.diagnosis.trend.weights.latent import NODES, latent, usual_Ohm
from models.diagnosis.trend.weights.summed import Summed, White
from models.effects.view import ModelInputs, View

_STEP = 2e-3
_JITTER = 1e-10


@dataclass(frozen=True)
class Given:
    """One run to be judged.

    Attributes
    ----------
    known : of the cell as it was
    run : on its grid
    soc, soc_std : at the start
    index : (m,) samples that are looked at
    ends : where the cell is full or empty
    steps : at which resistance is told
    """

    known: KnownRuns
    run: GridRun
    soc: float
    soc_std: float
    index: np.ndarray
    ends: Ends
    steps: Steps


@dataclass(frozen=True)
class Fresh:
    """The resistances of the first moment before the run was seen.

    Attributes
    ----------
    mean_Ohm : (n,) by the fresh cell's coefficients and its error elsewhere
    known, open : (n,) variances in Ohm^2 by what is fixed, and by the error elsewhere of a usual scale
    known_across, open_across : (n, N) covariances with the run
    """

    mean_Ohm: FloatArray
    known: FloatArray
    open: FloatArray
    known_across: FloatArray
    open_across: FloatArray


@dataclass(frozen=True)
class About:
    """A run about one capacity: its voltages, and then the SoC at its ends.

    Attributes
    ----------
    change : of the capacity, relative
    inputs : what the model makes of current and temperature
    error : (N,) what differs from the cell as it was, by this linear form: V and then SoC
    columns : (N, COUNT) derivatives of it to the weights of what may have changed; the first is the capacity
    mean : (N,) error that the model has elsewhere
    fixed, elsewhere : (N, N) covariances of what is known as it is, and of the model's own error of a usual scale
    fresh : resistances
    fresh_Ohm : (n,) by the coefficients alone
    usual_Ohm, typical_Ohm : that resistances are relative to, over SoC and where they are the same everywhere
    n_voltage : voltages
    """

    change: float
    inputs: ModelInputs
    error: FloatArray
    columns: FloatArray
    mean: FloatArray
    fixed: FloatArray
    elsewhere: FloatArray
    fresh: Fresh
    fresh_Ohm: FloatArray
    usual_Ohm: float
    typical_Ohm: float
    n_voltage: int

    @cached_property
    def white(self) -> tuple[White, ...]:
        """Error and columns by the root of the covariance, one for each scale of the error elsewhere."""
        stacked = np.column_stack([self.error, self.columns, self.fresh.known_across.T, self.fresh.open_across.T])
        k, n = self.columns.shape[1], len(self.fresh_Ohm)
        out = []
        for scale in SETTINGS.scales:
            whole = self.fixed + scale**2 * self.elsewhere
            whole[np.diag_indices_from(whole)] *= 1.0 + _JITTER
            lower = cholesky(whole, lower=True, check_finite=False, overwrite_a=True)
            each = solve_triangular(lower, stacked, lower=True, check_finite=False)
            across = each[:, 1 + k : 1 + k + n] + scale**2 * each[:, 1 + k + n :]
            out.append(White(scale, lower, each[:, 0], each[:, 1 : 1 + k], across))
        return tuple(out)

    @cached_property
    def summed(self) -> Summed:
        """What is kept of it."""
        fresh, sums = self.fresh, tuple(each.sums for each in self.white)
        ohms = (self.fresh_Ohm, self.usual_Ohm, self.typical_Ohm)
        return Summed(self.change, fresh.mean_Ohm, fresh.known, fresh.open, *ohms, sums)

    def at(self, given: Given, change: float) -> About:
        """The same run about another capacity; covariances, and what the current makes, stay as they are."""
        error, slope = _moved(given, self.inputs, change)
        error = error - self.mean + slope * change
        out = replace(self, change=change, error=error, columns=np.column_stack([slope, self.columns[:, 1:]]))
        out.__dict__["white"] = tuple(each.with_other(error, slope) for each in self.white)
        return out


def aged(cell: KnownCell, change: float) -> KnownCell:
    """The cell with another capacity."""
    return replace(cell, capacity_Ah=cell.capacity_Ah * (1.0 + change))


def about(given: Given, change: float) -> About:
    """Linearise a run about a capacity.

    Parameters
    ----------
    given : run
    change : of the capacity, relative
    """
    cell, e = aged(given.known.cell, change), len(given.ends.index)
    view = View(cell, given.run, given.soc, given.index)
    points = points_of(view, 0, cell.domain)
    mean, elsewhere, jump_mean, jump_variance, jump_across = _elsewhere(given, cell, points)
    rows = quick_rows(given.known.cell, given.steps)
    fresh_Ohm = rows @ given.known.cell.coefficients
    regressors = cell.regressors(view.inputs, view.soc[view.index])
    volts = regressors @ cell.covariance @ regressors.T
    volts[np.diag_indices_from(volts)] += KNOWN.least_V**2
    began = _with_start(start_columns(cell, view, given.soc_std), given.soc_std, e)
    fixed = _with_ends(volts, e) + began @ began.T
    fixed[np.arange(len(volts), len(fixed)), np.arange(len(volts), len(fixed))] += given.ends.std**2
    fresh = Fresh(
        fresh_Ohm + jump_mean,
        np.einsum("np,pq,nq->n", rows, cell.covariance, rows),
        jump_variance,
        _append(rows @ cell.covariance @ regressors.T, e),
        _append(jump_across, e),
    )
    usual = usual_Ohm(fresh_Ohm, cell)
    made = latent(view, points.slope_V, usual)
    error, slope = _moved(given, view.inputs, change)
    rest = np.vstack([made.volts, np.zeros((e, made.volts.shape[1]))])
    expected = np.append(mean, np.zeros(e))
    return About(
        change,
        view.inputs,
        error - expected + slope * change,
        np.column_stack([slope, rest]),
        expected,
        fixed,
        _with_ends(elsewhere, e),
        fresh,
        fresh_Ohm,
        usual,
        cell.typical_Ohm,
        len(mean),
    )


def _elsewhere(
    given: Given, cell: KnownCell, points: Points
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """(m,) mean and (m, m) covariance of the model's error, and (n,), (n,), (n, m) of resistance by it.

    The error of a resistance is that one sample after a step less that without it, with what the run has of its own.
    """
    m, n, elsewhere = len(points.soc), len(NODES), given.known.elsewhere
    stepped = step_points(cell, given.steps)
    both = Points.joined([points, stepped])
    mean, whole = elsewhere.conditional(both)
    turn = np.hstack([np.eye(n), -np.eye(n)]) / given.steps.current_A
    steps = whole[m:] + elsewhere.own_load(stepped, both)
    variance = np.einsum("ni,ij,nj->n", turn, steps[:, m:], turn)
    return mean[:m], whole[:m, :m] + elsewhere.in_time(points), turn @ mean[m:], variance, turn @ steps[:, :m]


def _moved(given: Given, inputs: ModelInputs, change: float) -> tuple[FloatArray, FloatArray]:
    """(N,) what differs from the model of a capacity, and what it differs by for each unit of the capacity more."""
    error, beyond = (off(given, inputs, each) for each in (change, change + _STEP))
    return error, (error - beyond) / _STEP


def off(given: Given, inputs: ModelInputs, change: float) -> FloatArray:
    """(N,) by how much a run differs from the model of a capacity: V, and then SoC at its ends."""
    run, cell, ends = given.run, given.known.cell, given.ends
    counted = given.soc + run.charge_Ah / (cell.capacity_Ah * (1.0 + change))
    simulated_V = cell.voltage_V(inputs, counted[given.index])
    return np.append(run.voltage_V[given.index] - simulated_V, ends.soc - counted[ends.index])


def _append(across: FloatArray, e: int) -> FloatArray:
    return np.hstack([across, np.zeros((len(across), e))])


def _with_ends(volts: FloatArray, e: int) -> FloatArray:
    out = np.zeros((len(volts) + e, len(volts) + e))
    out[: len(volts), : len(volts)] = volts
    return out


def _with_start(volts: FloatArray, soc_std: float, e: int) -> FloatArray:
    """(m + e, k) unknown states at the start; the first is the state of charge, which an end has, too."""
    ends = np.zeros((e, volts.shape[1]))
    ends[:, 0] = soc_std
    return np.vstack([volts, ends])
