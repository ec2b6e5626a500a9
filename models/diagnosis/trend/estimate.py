"""Capacity and resistance of a cell in one run, found together, beside all that is not known of cell and run.

A linear Gaussian estimate about the likeliest capacity, made again there: what is open of the fresh cell, its error
elsewhere and where the run starts are the same as in the evidence for a change; capacity, resistance and curve may all
have moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.trend.choice import chosen
from models.diagnosis.trend.ends import ends_of
from models.diagnosis.trend.prior import Given, Prior, aged, prior_of
from models.diagnosis.trend.settings import SETTINGS
from models.effects.view import View

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
class _Found:
    """Change of capacity and resistances for one scale of the error elsewhere; `log` is its likelihood's logarithm."""

    log: float
    mean: FloatArray
    variance: FloatArray


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
    given = Given(known, run, soc, soc_std, ends_of(known.cell, run, soc), np.linspace(0.0, 1.0, at.nodes))
    change = _first_guess(given)
    found: list[_Found] = []
    for _ in range(at.rounds):
        prior = prior_of(given, change)
        for _ in range(at.closer):
            before = change
            found = _solved(given, change, prior)
            best = max(found, key=lambda each: each.log)
            change = float(np.clip(best.mean[0], at.capacities[0] - 1.0, at.capacities[1] - 1.0))
            if abs(change - before) < at.settled:
                break
    return _mixed(known.cell, found, given.nodes)


def _first_guess(given: Given) -> float:
    """Relative change of capacity about which to begin: by the ends, else that by which most samples fit."""
    cell, run, ends, at = given.known.cell, given.run, given.ends, SETTINGS
    low, high, count = at.capacities
    far = np.abs(ends.soc - given.soc) > at.far_soc
    if far.any():
        share = run.charge_Ah[ends.index][far] / cell.capacity_Ah / (ends.soc - given.soc)[far]
        return float(np.clip(np.mean(share), low, high)) - 1.0
    index = chosen(np.flatnonzero(run.measured), at.points)
    view = View(cell, run, given.soc, index)
    charged = run.charge_Ah[index] / cell.capacity_Ah
    shares = np.linspace(low, high, count)
    costs = []
    for share in shares.tolist():
        error_V = run.voltage_V[index] - cell.voltage_V(view.inputs, given.soc + charged / share)
        costs.append(float(np.mean(np.minimum(np.abs(error_V), at.clipped_V) ** 2)))
    return float(shares[int(np.argmin(costs))]) - 1.0


def _solved(given: Given, change: float, prior: Prior) -> list[_Found]:
    """Estimates about a capacity, one for each scale of the error elsewhere."""
    at, (error, slope) = SETTINGS, _about(given, change, prior)
    out = []
    for scale in at.scales:
        whole = prior.fixed + scale**2 * prior.elsewhere + at.capacity**2 * np.outer(slope, slope)
        whole[np.diag_indices_from(whole)] *= 1.0 + _JITTER
        across = np.vstack([at.capacity**2 * slope, prior.known.across + scale**2 * prior.open.across])
        variance = np.append(at.capacity**2, prior.known.variance + scale**2 * prior.open.variance)
        factor = cho_factor(whole, lower=True, check_finite=False)
        weights = cho_solve(factor, np.column_stack([error, across.T]), check_finite=False)
        log = -0.5 * float(error @ weights[:, 0]) - float(np.sum(np.log(np.diag(factor[0]))))
        mean = across @ weights[:, 0] + np.append(0.0, prior.known.mean_Ohm + prior.open.mean_Ohm)
        out.append(_Found(log, mean, variance - np.einsum("nm,mn->n", across, weights[:, 1:])))
    return out


def _about(given: Given, change: float, prior: Prior) -> tuple[FloatArray, FloatArray]:
    """(m + e,) what differs from the model of the fresh capacity, linear about another, and its derivative."""
    run, cell, ends = given.run, given.known.cell, given.ends
    view = View(aged(cell, change), run, given.soc, prior.index)
    charged = run.charge_Ah / cell.capacity_Ah
    simulated_V = view.voltage_V
    moved = given.soc + charged[prior.index] / (1.0 + change + _STEP)
    slope_V = (cell.voltage_V(view.inputs, moved) - simulated_V) / _STEP
    counted = given.soc + charged[ends.index] / (1.0 + change)
    slope = np.append(slope_V, -charged[ends.index] / (1.0 + change) ** 2)
    error = np.append(run.voltage_V[prior.index] - simulated_V, ends.soc - counted)
    return error - prior.mean + slope * change, slope


def _mixed(cell: KnownCell, found: list[_Found], nodes: FloatArray) -> State:
    """All scales together, each as likely as it makes the run."""
    logs = np.array([each.log for each in found])
    share = np.exp(logs - logs.max())
    share /= share.sum()
    mean = np.array([each.mean for each in found])
    variance = np.array([each.variance for each in found])
    middle = share @ mean
    std = np.sqrt(np.maximum(share @ (variance + (mean - middle) ** 2), 1e-18))
    low, high = cell.soc_range
    told = (nodes >= low - KNOWN.away_soc) & (nodes <= high + KNOWN.away_soc)
    capacity_Ah = cell.capacity_Ah * (1.0 + float(middle[0]))
    return State(capacity_Ah, cell.capacity_Ah * float(std[0]), nodes[told], middle[1:][told], std[1:][told])
