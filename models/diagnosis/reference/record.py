"""Runs to be diagnosed, with the error of the network on them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.comparison.simulated_runs import simulate_runs
from models.data.errors import ModelError
from models.data.metrics import noise_floor_V
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray, TimeSeries
from models.network.local_model_network import LocalModelNetwork


@dataclass(frozen=True)
class Record:
    """Runs on the model's grid with the network's error.

    Attributes
    ----------
    runs, soc : with their SoC at the start
    error_V : (n,) of each run, measured minus the network's free run, NaN where nothing was measured
    """

    runs: list[GridRun]
    soc: list[float]
    error_V: list[FloatArray]

    @property
    def rms_mV(self) -> float:
        """Free-run RMSE in mV."""
        return 1e3 * float(np.sqrt(np.nanmean(np.concatenate(self.error_V) ** 2)))

    @property
    def n_measured(self) -> int:
        """Number of samples with a voltage."""
        return sum(int(np.count_nonzero(run.measured)) for run in self.runs)

    def of(self, runs: list[GridRun]) -> Record:
        """The same runs with some of their voltages alone."""
        error = [np.where(run.measured, each, np.nan) for run, each in zip(runs, self.error_V, strict=True)]
        return replace(self, runs=runs, error_V=error)

    def less(self, contributions: list[FloatArray]) -> Record:
        """The record with a part of the voltage explained."""
        left = [error - part for error, part in zip(self.error_V, contributions, strict=True)]
        return replace(self, error_V=left)

    @property
    def noise_floor_mV(self) -> float | None:
        """Of the measurement; None where it cannot be told."""
        floors = [noise_floor_V(run.voltage_V, run.current_A) for run in self.runs]
        known = [floor for floor in floors if np.isfinite(floor)]
        return 1e3 * float(np.median(known)) if known else None


def make_record(network: LocalModelNetwork, runs: list[TimeSeries], soc: list[float]) -> Record:
    """Simulate runs.

    Raises
    ------
    ModelError
        The model gives no voltage on them.
    """
    compared = simulate_runs(network, runs, soc)
    error = [each.residual_V for each in compared]
    if not np.isfinite(np.concatenate(error)).any():
        raise ModelError("the model gives no voltage on these runs: temperature is missing, or it is for another cell")
    return Record([each.run for each in compared], list(soc), error)
