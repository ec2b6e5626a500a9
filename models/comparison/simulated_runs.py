"""Measured runs beside a model's free run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from models.comparison.reach import inside_by
from models.comparison.start import Start, free_run_from_V
from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.effects.input_correction import as_read
from models.network.cell_model import CellModel
from models.network.signals import soc_by_counting


@dataclass(frozen=True)
class RunComparison:
    """One run beside its free run, on the model's grid.

    Attributes
    ----------
    run : the measurement, as the model reads it
    simulated_V : (n,) free run
    soc : (n,) counted state of charge
    inside : (n,) whether current, temperature, SoC and slow states lie in the trained domain
    start : where it begins
    """

    run: GridRun
    simulated_V: FloatArray
    soc: FloatArray
    inside: np.ndarray
    start: Start = field(default_factory=lambda: Start(0.5))

    @property
    def residual_V(self) -> FloatArray:
        """Measured minus simulated voltage in V, NaN where none was measured."""
        return self.run.voltage_V - self.simulated_V


def simulate_runs(network: CellModel, runs: list[TimeSeries], initial_soc: list[float]) -> list[RunComparison]:
    """Free run of each measured run from rest, its columns corrected as the model's record says."""
    grid = [on_grid(network, run) for run in runs]
    return [beside(network, run, Start(soc)) for run, soc in zip(grid, initial_soc, strict=True)]


def on_grid(network: CellModel, run: TimeSeries) -> GridRun:
    """A run as the model reads it, on its grid."""
    return to_grid(as_read(network.record, run), network.dt_s)


def beside(network: CellModel, run: GridRun, start: Start) -> RunComparison:
    """A run on the model's grid beside its free run from a start."""
    soc = soc_by_counting(run.charge_Ah, start.initial_soc, network.cell.capacity_Ah, network.cell.efficiency)
    inside = inside_domain(network, run, soc, start)
    return RunComparison(run, free_run_from_V(network, run, start), soc, inside, start)


def inside_domain(network: CellModel, run: GridRun, soc: FloatArray, start: Start | None = None) -> np.ndarray:
    """Whether each sample lies in the trained ranges of SoC, current, temperature and slow states."""
    return np.logical_and.reduce([np.ones(len(run), dtype=bool), *inside_by(network, run, soc, start).values()])
