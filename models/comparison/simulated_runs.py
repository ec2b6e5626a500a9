"""Measured runs beside a model's free run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.comparison.reach import inside_by
from models.data.metrics import Metrics, metrics
from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.effects.input_correction import as_read
from models.network.cell_model import CellModel
from models.network.free_run import free_run_V
from models.network.signals import soc_by_counting


@dataclass(frozen=True)
class RunComparison:
    """One run beside its free run, on the model's grid.

    Attributes
    ----------
    run : the measurement, as the model reads it
    simulated_V : (n,) free run
    soc : (n,) counted state of charge
    inside : (n,) whether current, temperature and SoC lie in the trained domain
    """

    run: GridRun
    simulated_V: FloatArray
    soc: FloatArray
    inside: np.ndarray

    @property
    def residual_V(self) -> FloatArray:
        """Simulated minus measured voltage in V, NaN where none was measured."""
        return self.simulated_V - self.run.voltage_V


def simulate_runs(network: CellModel, runs: list[TimeSeries], initial_soc: list[float]) -> list[RunComparison]:
    """Free run of each measured run, its columns corrected as the model's record says."""
    results = []
    for series, soc0 in zip(runs, initial_soc, strict=True):
        run = to_grid(as_read(network.record, series), network.dt_s)
        soc = soc_by_counting(run.charge_Ah, soc0, network.cell.capacity_Ah, network.cell.efficiency)
        results.append(RunComparison(run, free_run_V(network, run, soc0), soc, inside_domain(network, run, soc)))
    return results


def free_run_metrics(network: CellModel, runs: list[TimeSeries], initial_soc: list[float]) -> Metrics:
    """Figures of the free run over all runs together."""
    compared = simulate_runs(network, runs, initial_soc)
    measured = np.concatenate([each.run.voltage_V for each in compared])
    return metrics(measured, np.concatenate([each.simulated_V for each in compared]))


def inside_domain(network: CellModel, run: GridRun, soc: FloatArray) -> np.ndarray:
    """Whether each sample lies in the ranges of SoC, current and temperature that the model was trained on."""
    return np.logical_and.reduce([np.ones(len(run), dtype=bool), *inside_by(network, run, soc).values()])
