"""Capacity and resistance of a cell in one run, found together, beside all that is not known of cell and run.

A linear Gaussian estimate about the likeliest capacity, made again there: what is open of the fresh cell, its error
elsewhere and where the run starts are the same as in the evidence for a change; capacity, resistance and curve may all
have moved.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.elsewhere import points_of
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.likelihood.start import start_columns
from models.diagnosis.trend.choice import around_steps, chosen
from models.diagnosis.trend.quick import quick_rows
from models.diagnosis.trend.settings import SETTINGS
from models.effects.view import View
from models.identification.bounded.knots import hats

_STEP = 2e-3
_JITTER = 1e-10


@dataclass(frozen=True)
class State:
    """A cell as a run shows it.

    Attributes
    ----------
    capacity_Ah, capacity_std_Ah : with its standard deviation
    soc : (n,) at which the resistance is told
    resistance_Ohm, resistance_std_Ohm : (n,) of the first moment after a step of the run's current
    """

    capacity_Ah: float
    capacity_std_Ah: float
    soc: FloatArray
    resistance_Ohm: FloatArray
    resistance_std_Ohm: FloatArray


@dataclass(frozen=True)
class _Prior:
    """What the samples are expected to be about the model's voltage for one capacity.

    Attributes
    ----------
    index : (m,) samples
    mean_V : (m,)
    fixed, elsewhere : (m, m) covariances in V^2, all but that of the capacity
    across : (n, m) covariance of the resistances at the nodes and the samples, Ohm V
    """

    index: np.ndarray
    mean_V: FloatArray
    fixed: FloatArray
    elsewhere: FloatArray
    across: FloatArray


@dataclass(frozen=True)
class _Found:
    """Change of capacity and resistances for one scale of the error elsewhere; `log` is its likelihood's logarithm."""

    log: float
    change: float
    variance: float
    moved_Ohm: FloatArray
    variance_Ohm2: FloatArray


def estimate(known: KnownRuns, run: GridRun, soc: float, soc_std: float) -> State:
    """Find the state of a cell from one run.

    Parameters
    ----------
    known : of the cell as it was
    run : on its grid
    soc, soc_std : at the start, of the new capacity

    Raises
    ------
    ModelError
        No sample of the run can be judged.
    """
    at = SETTINGS
    nodes = np.linspace(0.0, 1.0, at.nodes)
    rows = quick_rows(known.cell, run, nodes)
    change = _first_guess(known.cell, run, soc)
    found: list[_Found] = []
    for _ in range(at.rounds):
        prior = _prior(known, run, soc, soc_std, change, nodes, rows)
        for _ in range(at.closer):
            before = change
            found = _solved(known.cell, run, soc, change, prior)
            best = max(found, key=lambda each: each.log)
            change = float(np.clip(best.change, at.capacities[0] - 1.0, at.capacities[1] - 1.0))
            if abs(change - before) < at.settled:
                break
    own = _own_variance(known.cell, rows)
    return _mixed(known.cell, found, nodes, rows @ known.cell.coefficients, own)


def _aged(cell: KnownCell, change: float) -> KnownCell:
    return replace(cell, capacity_Ah=cell.capacity_Ah * (1.0 + change))


def _first_guess(cell: KnownCell, run: GridRun, soc: float) -> float:
    """Relative change of capacity by which most samples fit: about the true one, not about zero, all is linear."""
    index = chosen(np.flatnonzero(run.measured), SETTINGS.points)
    view = View(cell, run, soc, index)
    charged = run.charge_Ah[index] / cell.capacity_Ah
    low, high, count = SETTINGS.capacities
    shares = np.linspace(low, high, count)
    costs = []
    for share in shares.tolist():
        error_V = run.voltage_V[index] - cell.voltage_V(view.inputs, soc + charged / share)
        costs.append(float(np.mean(np.minimum(np.abs(error_V), SETTINGS.clipped_V) ** 2)))
    return float(shares[int(np.argmin(costs))]) - 1.0


def _prior(
    known: KnownRuns, run: GridRun, soc: float, soc_std: float, change: float, nodes: FloatArray, rows: FloatArray
) -> _Prior:
    cell, at = _aged(known.cell, change), SETTINGS
    index = _looked_at(cell, run, soc)
    view = View(cell, run, soc, index)
    points = points_of(view, 0, cell.domain)
    mean_V, elsewhere = known.elsewhere.conditional(points)
    here = hats(nodes, np.clip(points.soc, 0.0, 1.0))
    curve = at.curve_V**2 * _alike(nodes, at.curve_soc)
    elsewhere = elsewhere + known.elsewhere.in_time(points) + here @ curve @ here.T
    regressors = cell.regressors(view.inputs, points.soc)
    start = start_columns(cell, view, soc_std)
    alike = _alike(nodes, at.alike_soc)
    quick = here * run.current_A[index][:, None]
    fresh_Ohm = rows @ cell.coefficients
    usual = at.resistance * max(float(np.median(np.abs(fresh_Ohm))), 1e-9)
    slower = at.slower * here * view.overvoltage(run.current_A)[:, None]
    fixed = regressors @ cell.covariance @ regressors.T + start @ start.T
    fixed += usual**2 * quick @ alike @ quick.T + slower @ alike @ slower.T
    fixed[np.diag_indices_from(fixed)] += KNOWN.least_V**2
    across = rows @ cell.covariance @ regressors.T + usual**2 * alike @ quick.T
    across += at.slower * fresh_Ohm[:, None] * (alike @ slower.T)
    return _Prior(index, mean_V, fixed, elsewhere, across)


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


def _alike(nodes: FloatArray, length: float) -> FloatArray:
    return np.exp(-0.5 * ((nodes[:, None] - nodes[None, :]) / length) ** 2)


def _solved(cell: KnownCell, run: GridRun, soc: float, change: float, prior: _Prior) -> list[_Found]:
    """Estimates about a capacity, one for each scale of the error elsewhere."""
    at = SETTINGS
    view = View(_aged(cell, change), run, soc, prior.index)
    charged = run.charge_Ah[prior.index] / cell.capacity_Ah
    simulated_V = view.voltage_V
    slope = (cell.voltage_V(view.inputs, soc + charged / (1.0 + change + _STEP)) - simulated_V) / _STEP
    error_V = run.voltage_V[prior.index] - simulated_V - prior.mean_V + slope * change
    across = np.vstack([at.capacity**2 * slope, prior.across])
    out = []
    for scale in at.scales:
        whole = prior.fixed + scale**2 * prior.elsewhere + at.capacity**2 * np.outer(slope, slope)
        whole[np.diag_indices_from(whole)] *= 1.0 + _JITTER
        factor = cho_factor(whole, lower=True, check_finite=False)
        weights = cho_solve(factor, np.column_stack([error_V, across.T]), check_finite=False)
        log = -0.5 * float(error_V @ weights[:, 0]) - float(np.sum(np.log(np.diag(factor[0]))))
        mean = across @ weights[:, 0]
        known = np.einsum("nm,mn->n", across, weights[:, 1:])
        out.append(_Found(log, float(mean[0]), at.capacity**2 - float(known[0]), mean[1:], known[1:]))
    return out


def _own_variance(cell: KnownCell, rows: FloatArray) -> FloatArray:
    """(n,) variance of the resistances in Ohm^2 before the run was seen."""
    fresh_Ohm = rows @ cell.coefficients
    usual = SETTINGS.resistance * max(float(np.median(np.abs(fresh_Ohm))), 1e-9)
    return np.einsum("np,pq,nq->n", rows, cell.covariance, rows) + usual**2 + (SETTINGS.slower * fresh_Ohm) ** 2


def _mixed(cell: KnownCell, found: list[_Found], nodes: FloatArray, fresh_Ohm: FloatArray, own: FloatArray) -> State:
    """All scales together, each as likely as it makes the run."""
    logs = np.array([each.log for each in found])
    share = np.exp(logs - logs.max())
    share /= share.sum()
    mean = np.array([[each.change, *each.moved_Ohm] for each in found])
    variance = np.array([[each.variance, *(own - each.variance_Ohm2)] for each in found])
    middle = share @ mean
    std = np.sqrt(np.maximum(share @ (variance + (mean - middle) ** 2), 1e-18))
    low, high = cell.soc_range
    told = (nodes >= low - KNOWN.away_soc) & (nodes <= high + KNOWN.away_soc)
    return State(
        cell.capacity_Ah * (1.0 + float(middle[0])),
        cell.capacity_Ah * float(std[0]),
        nodes[told],
        (fresh_Ohm + middle[1:])[told],
        std[1:][told],
    )
