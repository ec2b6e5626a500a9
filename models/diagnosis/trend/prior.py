"""What a run of an aged cell is expected to be about the fresh cell's model, and what it has to do with resistance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.elsewhere import Points, points_of
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.likelihood.start import start_columns
from models.diagnosis.trend.choice import around_steps, chosen
from models.diagnosis.trend.ends import Ends
from models.diagnosis.trend.quick import quick_rows, step_points, usual_step
from models.diagnosis.trend.settings import SETTINGS
from models.effects.view import View
from models.identification.bounded.knots import hats


@dataclass(frozen=True)
class Given:
    """One run to be judged.

    Attributes
    ----------
    known : of the cell as it was
    run : on its grid
    soc, soc_std : at the start
    ends : where the cell is full or empty
    nodes : (n,) SoC at which resistance is told
    """

    known: KnownRuns
    run: GridRun
    soc: float
    soc_std: float
    ends: Ends
    nodes: FloatArray


@dataclass(frozen=True)
class Resistances:
    """The resistances of the first moment before the run was seen.

    Attributes
    ----------
    mean_Ohm : (n,)
    variance : (n,) in Ohm^2
    across : (n, m + e) covariance with the run
    """

    mean_Ohm: FloatArray
    variance: FloatArray
    across: FloatArray


@dataclass(frozen=True)
class Prior:
    """What a run is expected to be for one capacity: its voltages, and then the SoC at its ends.

    Attributes
    ----------
    index : (m,) samples
    mean : (m + e,) V and then SoC
    fixed, elsewhere : (m + e, m + e) covariances, but that of the capacity; the latter for a usual scale
    known, open : the resistances by what is fixed, and by the error elsewhere
    """

    index: np.ndarray
    mean: FloatArray
    fixed: FloatArray
    elsewhere: FloatArray
    known: Resistances
    open: Resistances


def aged(cell: KnownCell, change: float) -> KnownCell:
    """The cell with another capacity."""
    return replace(cell, capacity_Ah=cell.capacity_Ah * (1.0 + change))


def prior_of(given: Given, change: float) -> Prior:
    """Make it.

    Parameters
    ----------
    given : run
    change : of the capacity, relative

    Raises
    ------
    ModelError
        No sample of the run can be judged.
    """
    cell, e = aged(given.known.cell, change), len(given.ends.index)
    view = View(cell, given.run, given.soc, _looked_at(cell, given.run, given.soc))
    mean, elsewhere, opened = _elsewhere(given, cell, view)
    fixed, known = _fixed(given, cell, view)
    return Prior(view.index, np.append(mean, np.zeros(e)), fixed, _with_ends(elsewhere, e), known, opened)


def _looked_at(cell: KnownCell, run: GridRun, soc: float) -> np.ndarray:
    """(m,) samples within the trained SoC: spread over the run, and those around steps of the current."""
    counted = soc + run.charge_Ah / cell.capacity_Ah
    low, high = cell.soc_range
    inside = run.measured & (counted >= low - KNOWN.away_soc) & (counted <= high + KNOWN.away_soc)
    places = np.flatnonzero(inside)
    if not len(places):
        raise ModelError(
            f"{run.name}: no sample lies within the trained state of charge, {low:.2f} to {high:.2f}; give the right "
            "SoC at the start, or train on runs that cover it"
        )
    near = around_steps(run.current_A, SETTINGS.step_C * cell.capacity_Ah)
    return np.union1d(chosen(places, SETTINGS.points), near[inside[near]])


def _elsewhere(given: Given, cell: KnownCell, view: View) -> tuple[FloatArray, FloatArray, Resistances]:
    """(m,) mean and (m, m) covariance of the model's error and of a curve that has moved; of resistance by the former.

    The error of a resistance is that one sample after a step less that without it.
    """
    at, nodes, m, e = SETTINGS, given.nodes, len(view.index), len(given.ends.index)
    points = points_of(view, 0, cell.domain)
    size_A, _ = usual_step(cell, given.run)
    mean, whole = given.known.elsewhere.conditional(Points.joined([points, step_points(cell, given.run, nodes)]))
    turn = np.hstack([np.eye(len(nodes)), -np.eye(len(nodes))]) / size_A
    variance = np.einsum("ni,ij,nj->n", turn, whole[m:, m:], turn)
    jumps = Resistances(turn @ mean[m:], variance, _append(turn @ whole[m:, :m], e))
    here, alike = hats(nodes, np.clip(points.soc, 0.0, 1.0)), _alike(nodes, at.curve_soc)
    slipped = here * points.slope_V[:, None]
    moved = at.curve_V**2 * here @ alike @ here.T + at.slip**2 * slipped @ alike @ slipped.T
    return mean[:m], whole[:m, :m] + given.known.elsewhere.in_time(points) + moved, jumps


def _fixed(given: Given, cell: KnownCell, view: View) -> tuple[FloatArray, Resistances]:
    """(m + e, m + e) covariance of all else: open coefficients, start, ends, and resistances that have changed."""
    at, nodes, e = SETTINGS, given.nodes, len(given.ends.index)
    rows = quick_rows(cell, given.run, nodes)
    soc = view.soc[view.index]
    regressors = cell.regressors(view.inputs, soc)
    began = _with_start(start_columns(cell, view, given.soc_std), given.soc_std, e)
    here, alike = hats(nodes, np.clip(soc, 0.0, 1.0)), _alike(nodes, at.alike_soc)
    fresh_Ohm = rows @ cell.coefficients
    usual = at.resistance * max(float(np.median(np.abs(fresh_Ohm))), 1e-9)
    quick = here * given.run.current_A[view.index][:, None]
    slower = at.slower * here * view.overvoltage(given.run.current_A)[:, None]
    volts = regressors @ cell.covariance @ regressors.T
    volts += usual**2 * quick @ alike @ quick.T + slower @ alike @ slower.T
    volts[np.diag_indices_from(volts)] += KNOWN.least_V**2
    fixed = _with_ends(volts, e) + began @ began.T
    fixed[np.arange(len(volts), len(fixed)), np.arange(len(volts), len(fixed))] += at.end_std**2
    across = rows @ cell.covariance @ regressors.T + usual**2 * alike @ quick.T
    across += at.slower * fresh_Ohm[:, None] * (alike @ slower.T)
    variance = np.einsum("np,pq,nq->n", rows, cell.covariance, rows) + usual**2 + (at.slower * fresh_Ohm) ** 2
    return fixed, Resistances(fresh_Ohm, variance, _append(across, e))


def _alike(nodes: FloatArray, length: float) -> FloatArray:
    return np.exp(-0.5 * ((nodes[:, None] - nodes[None, :]) / length) ** 2)


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
