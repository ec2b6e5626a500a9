"""Training runs on the model's grid, with what they leave open: everything that a fit starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.comparison.start import Start
from models.data.errors import ModelError
from models.data.metrics import noise_floor_V
from models.data.resampling import GridRun, to_grid, typical_interval_s
from models.data.start_soc import start_soc
from models.data.timeseries import FloatArray, TimeSeries
from models.identification.excitation import check_excitation, check_series
from models.network.model_record import Domain
from models.network.regression import CellContext
from models.network.signals import soc_by_counting
from models.network.signals.filters import slow_current_A


@dataclass(frozen=True)
class Training:
    """Runs that a model is made from.

    Attributes
    ----------
    runs : as they were measured
    grid : the same at the model's sampling time
    starts : where each begins: as stated, until a model tells more (`models.pipeline.run_starts`)
    fit_grid, fit_soc : what a model is fitted to: the grid with what flowed before each run in front, and the state of
        charge there
    cell : capacity and efficiency
    dt_s : sampling time
    reservations : what the data leave open, one sentence each
    """

    runs: list[TimeSeries]
    grid: list[GridRun]
    starts: list[Start]
    fit_grid: list[GridRun]
    fit_soc: list[float]
    cell: CellContext
    dt_s: float
    reservations: list[str]

    @property
    def soc(self) -> list[float]:
        """Fraction at the start of each run."""
        return [start.initial_soc for start in self.starts]

    @property
    def n_samples(self) -> int:
        """Samples on the grid."""
        return sum(len(run) for run in self.grid)

    @property
    def n_missing(self) -> int:
        """Samples on the grid without voltage."""
        return sum(run.n_missing for run in self.grid)

    @property
    def has_temperature(self) -> bool:
        """Whether every run has a temperature; a single missing value is bridged, see `to_grid`."""
        return not any(np.isnan(run.temperature_degC).any() for run in self.grid)

    @property
    def noise_floor_mV(self) -> float | None:
        """Median over the runs; None where no run is steady for long enough to show it."""
        floors = [noise_floor_V(run.voltage_V, run.current_A) for run in self.grid]
        known = [floor for floor in floors if np.isfinite(floor)]
        return 1e3 * float(np.median(known)) if known else None

    def counted_soc(self) -> list[FloatArray]:
        """(n,) fraction over each run."""
        cell = self.cell
        return [
            soc_by_counting(run.charge_Ah, soc, cell.capacity_Ah, cell.efficiency)
            for run, soc in zip(self.grid, self.soc, strict=True)
        ]

    @property
    def domain(self) -> Domain:
        """Ranges of SoC, current, slow states and temperature."""
        slow = [slow_current_A(run.current_A, run.dt_s) for run in self.grid]
        domain = {"soc": _range(self.counted_soc()), "current_A": _range([run.current_A for run in self.grid])}
        domain["slow_current_A"] = _range(slow)
        if self.has_temperature:
            domain["temperature_degC"] = _range([run.temperature_degC for run in self.grid])
        return domain


def training(
    runs: list[TimeSeries],
    capacity_Ah: float,
    initial_soc: list[float] | None = None,
    dt_s: float | None = None,
    coulombic_efficiency: float = 1.0,
) -> Training:
    """Bring runs to the model's grid, and refuse those that cannot determine a model.

    Parameters
    ----------
    runs : runs that the model is made from
    capacity_Ah : cell capacity
    initial_soc : fraction at the start of each; by default its first `soc_ref`
    dt_s : sampling time; by default the typical interval of the runs
    coulombic_efficiency : share of the charge going in that comes out again

    Raises
    ------
    NotIdentifiableError
        The data cannot determine the model; the message names what is missing in physical words.
    ModelError
        Bad capacity or efficiency, no run, or no initial SoC.
    """
    if not runs:
        raise ModelError("no training run was given")
    if not (np.isfinite(capacity_Ah) and capacity_Ah > 0.0):
        raise ModelError(f"capacity is {capacity_Ah:g} Ah; it must be positive")
    if not 0.0 < coulombic_efficiency <= 1.0:
        raise ModelError(
            f"coulombic efficiency is {coulombic_efficiency:g}; it must lie above 0 and up to 1, such as 0.999"
        )
    step_s = dt_s if dt_s is not None else typical_interval_s(runs)
    soc = initial_soc or [start_soc(run) for run in runs]
    cell = CellContext(capacity_Ah, coulombic_efficiency)
    reservations = check_series(runs, step_s, capacity_Ah)
    grid = [to_grid(run, step_s) for run in runs]
    reservations += check_excitation(grid, soc, cell)
    return Training(runs, grid, [Start(each) for each in soc], grid, soc, cell, step_s, reservations)


def _range(parts: list[FloatArray]) -> tuple[float, float]:
    return float(min(p.min() for p in parts)), float(max(p.max() for p in parts))
