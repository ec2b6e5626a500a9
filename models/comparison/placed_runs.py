"""Measured runs beside a model's free run, each from where it begins: as stated, or as its voltage says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from models.comparison.simulated_runs import RunComparison, beside, inside_domain, on_grid
from models.comparison.start import Start
from models.comparison.start_fit import start_from_head, start_from_run
from models.data.metrics import Metrics, metrics
from models.data.timeseries import TimeSeries
from models.network.cell_model import CellModel

# How far off a state of charge may be that somebody only believes, where a start is fitted to find that out.
WORD_STD = 0.1


def place_runs(network: CellModel, runs: list[TimeSeries], initial_soc: list[float]) -> list[RunComparison]:
    """Free run of each measured run from its stated state of charge.

    A run that plainly does not begin at rest is started with the history that its first 60 s show; nothing later of the
    voltage is used.
    """
    grid = [on_grid(network, run) for run in runs]
    starts = [start_from_head(network, run, Start(soc)) for run, soc in zip(grid, initial_soc, strict=True)]
    return [beside(network, run, start) for run, start in zip(grid, starts, strict=True)]


def free_run_metrics(network: CellModel, runs: list[TimeSeries], initial_soc: list[float]) -> Metrics:
    """Figures of the free run over all runs together, as a comparison has them."""
    return _metrics(place_runs(network, runs, initial_soc))


def _metrics(compared: list[RunComparison]) -> Metrics:
    measured = np.concatenate([each.run.voltage_V for each in compared])
    return metrics(measured, np.concatenate([each.simulated_V for each in compared]))


class ErrorsApart(NamedTuple):
    """Free-run RMSE in mV over all runs together, and apart inside and outside of trained ranges.

    None where no measured sample lies there.
    """

    overall_mV: float
    inside_mV: float | None
    outside_mV: float | None


def errors_apart(
    network: CellModel, runs: list[TimeSeries], initial_soc: list[float], trained: CellModel
) -> ErrorsApart:
    """Free-run errors of a model, parted by the ranges that another one was trained in.

    Parameters
    ----------
    network : what is simulated
    runs, initial_soc : what it is held against
    trained : whose ranges part the samples, so that two versions are judged on the same ones
    """
    compared = place_runs(network, runs, initial_soc)
    squares_V2 = np.concatenate([each.residual_V**2 for each in compared])
    inside = np.concatenate([inside_domain(trained, each.run, each.soc, each.start) for each in compared])
    parts = [squares_V2[chosen & ~np.isnan(squares_V2)] for chosen in (inside, ~inside)]
    inside_mV, outside_mV = (1e3 * float(np.sqrt(part.mean())) if len(part) else None for part in parts)
    return ErrorsApart(_metrics(compared)["rmse_mV"], inside_mV, outside_mV)


def fit_starts(
    network: CellModel, compared: list[RunComparison], soc_std: Sequence[float | None] | None = None
) -> list[RunComparison]:
    """The same runs from starts that all of their voltage says.

    Parameters
    ----------
    network : the model
    compared : runs from their stated starts
    soc_std : standard deviation of each stated state of charge; None: somebody's word
    """
    known = [None] * len(compared) if soc_std is None else soc_std
    return [_fitted(network, each, WORD_STD if std is None else std) for each, std in zip(compared, known, strict=True)]


def _fitted(network: CellModel, compared: RunComparison, soc_std: float) -> RunComparison:
    stated = Start(compared.start.initial_soc, soc_std)
    found = beside(network, compared.run, start_from_run(network, compared.run, stated))
    if _squares_V2(found) <= _squares_V2(compared):
        return found
    # The first minute alone did better, at the stated state of charge: that one is then off by no more than this.
    away = found.start.initial_soc - stated.initial_soc
    std = min(float(np.hypot(found.start.soc_std or 0.0, away)), soc_std)
    return replace(compared, start=replace(compared.start, soc_std=std))


def _squares_V2(compared: RunComparison) -> float:
    return float(np.nansum(compared.residual_V**2))
