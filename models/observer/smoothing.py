"""The best after-the-fact state of charge of a whole run: what the end knows, carried back to every sample.

Beside the model's errors, all that makes a state of charge uncertain is constant: where the run began, the offset of
the current sensor, the capacity. What the filter knows of them at its last sample it has from all of the run; counted
back from there it holds for every sample before. For constants without process noise this is the fixed-interval
smoother of Rauch, Tung and Striebel (AIAA J. 3, 1965); the little drift that the counter is given widens the band
towards the start. Beyond a stretch without a current the end says little; where the filter itself knew more by then,
that is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun, fill_hold
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.observer.filter import places
from models.observer.filter.fuzzy_observer import FuzzyObserver, ObserverState


@dataclass(frozen=True)
class Smoothed:
    """State of charge of each sample with all of the run known, (n,) each."""

    soc: FloatArray
    soc_std: FloatArray


def smoothed_soc(observer: FuzzyObserver, run: GridRun, end: ObserverState, rows: FloatArray) -> Smoothed:
    """Count back from the state after a run's last sample.

    Parameters
    ----------
    observer : of the cell
    run : on the model's grid, as the cell sees it
    end : the state after the last sample of the same run
    rows : (n, columns) what the filter said

    Returns
    -------
    The standard deviation is widened by the observer's band factor, as the filter's own.
    """
    network, settings = observer.network, observer.settings
    hours, cell = observer.dt_s / 3600.0, network.cell
    current_A = fill_hold(run.logged_current_A)
    moved = np.where(current_A > 0.0, cell.efficiency, 1.0) * current_A * hours / cell.capacity_Ah
    moved[0] = 0.0
    # What comes after each sample, as the filter has counted it.
    later = np.concatenate([np.cumsum(moved[:0:-1])[::-1], [0.0]])
    left_h = hours * np.arange(len(moved) - 1, -1, -1)
    slopes = np.column_stack([np.ones(len(later)), left_h / cell.capacity_Ah, -later])
    n = max(network.structure.output_order, 1)
    at = np.array([n, n + places.AT_OFFSET, n + places.AT_CAPACITY])
    alive = np.flatnonzero(end.weight > 0.0)
    share = end.weight[alive] / end.weight[alive].sum()
    # Each place that is still held possible has a course of its own.
    each = end.x[np.ix_(alive, at)] @ slopes.T - later
    soc = share @ each
    within = np.array([np.einsum("ka,ab,kb->k", slopes, end.covariance[j][np.ix_(at, at)], slopes) for j in alive])
    variance = share @ (np.maximum(within, 0.0) + (each - soc) ** 2)
    drift = settings.soc_std_per_sqrt_s**2 * 3600.0 * left_h
    std = settings.band_factor * np.sqrt(variance + drift + _lost(network, run))
    if run.current_known is None:
        return Smoothed(soc, std)
    sooner = rows[:, places.SOC_STD_OUT] < std
    return Smoothed(np.where(sooner, rows[:, places.SOC_OUT], soc), np.where(sooner, rows[:, places.SOC_STD_OUT], std))


def _lost(network: LocalModelNetwork, run: GridRun) -> FloatArray:
    """(n,) variance of the charge from each sample to the end where the current is missing, as the filter has it."""
    if run.current_known is None:
        return np.zeros(len(run))
    # From the end on, sample by sample: so many in a row without a current.
    lost = ~run.current_known[:0:-1]
    count = np.cumsum(lost)
    in_a_row = count - np.maximum.accumulate(np.where(lost, 0, count))
    total = np.concatenate([np.cumsum(np.where(lost, 2.0 * in_a_row - 1.0, 0.0))[::-1], [0.0]])
    each = places.UNKNOWN_CURRENT * network.cell.rest_A * run.dt_s / 3600.0 / network.cell.capacity_Ah
    return each**2 * total
