"""Training runs of a baseline, laid one after the other, and the refusal of what no circuit can be fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.errors import ModelError, NotIdentifiableError
from models.data.resampling import GridRun, to_grid, typical_interval_s
from models.data.start_soc import start_soc
from models.data.timeseries import FloatArray, TimeSeries
from models.network import folds as holdout
from models.network.model_record import Domain
from models.network.regression import CellContext
from models.network.signals import soc_by_counting

_MIN_SAMPLES = 200
_MIN_STEPS = 5
_MIN_SOC_RANGE = 0.03
# Temperatures closer together than this are one: sensors differ by as much.
_MIN_TEMPERATURE_RANGE_K = 3.0
# Share of the charge moved against the main direction, below which hysteresis cannot be told from the curve.
_MIN_COUNTER_CHARGE = 0.02


@dataclass(frozen=True)
class Samples:
    """Training samples on one grid.

    Attributes
    ----------
    current_A, soc, temperature_degC, voltage_V : (N,); NaN where the voltage is missing
    starts : first index of each part; run_starts : of each run
    fold : (N,) fold that a sample is held out with, -1 where it was not measured
    n_folds : number of folds
    dt_s : grid step in s
    longest_s : duration of the longest run
    cell : capacity and efficiency
    names : of the runs
    """

    current_A: FloatArray
    soc: FloatArray
    temperature_degC: FloatArray
    voltage_V: FloatArray
    starts: np.ndarray
    run_starts: np.ndarray
    fold: np.ndarray
    n_folds: int
    dt_s: float
    longest_s: float
    cell: CellContext
    names: list[str]

    def domain(self) -> Domain:
        """Ranges of state of charge, current and temperature; no temperature where none was measured."""
        values = {"soc": self.soc, "current_A": self.current_A, "temperature_degC": self.temperature_degC}
        return {
            name: (float(column.min()), float(column.max()))
            for name, column in values.items()
            if not np.isnan(column).any()
        }

    def temperature_knots_degC(self, spacing_K: float, most: int) -> FloatArray:
        """Knots over the measured temperatures; one where they hardly differ or are unknown."""
        if np.isnan(self.temperature_degC).any():
            return np.array([25.0])
        low, high = float(self.temperature_degC.min()), float(self.temperature_degC.max())
        if high - low < _MIN_TEMPERATURE_RANGE_K:
            return np.array([0.5 * (low + high)])
        return np.linspace(low, high, int(np.clip(round((high - low) / spacing_K) + 1, 2, most)))


def gather(train: list[TimeSeries], capacity_Ah: float, initial_soc: list[float] | None, dt_s: float | None) -> Samples:
    """Put training runs on one grid and check that a circuit can be seen in them.

    Raises
    ------
    NotIdentifiableError
        No current, no change of current, one state of charge only, too few samples.
    ModelError
        No run, bad capacity, no initial state of charge.
    """
    if not train:
        raise ModelError("no training run was given")
    if not (np.isfinite(capacity_Ah) and capacity_Ah > 0.0):
        raise ModelError(f"capacity is {capacity_Ah:g} Ah; it must be positive")
    step_s = dt_s if dt_s is not None else typical_interval_s(train)
    grid = [to_grid(run, step_s) for run in train]
    cell = CellContext(capacity_Ah)
    begin = initial_soc if initial_soc is not None else [start_soc(run) for run in train]
    soc = [
        soc_by_counting(run.charge_Ah, s, cell.capacity_Ah, cell.efficiency) for run, s in zip(grid, begin, strict=True)
    ]
    samples = _joined(grid, soc, step_s, cell)
    _check(samples)
    return samples


def check_both_directions(samples: Samples) -> None:
    """Refuse hysteresis where the current hardly ever turns.

    Raises
    ------
    NotIdentifiableError
        Less than 2 % of the charge moves against the main direction.
    """
    moved = [float(np.clip(sign * samples.current_A, 0.0, None).sum()) for sign in (1.0, -1.0)]
    if min(moved) < _MIN_COUNTER_CHARGE * sum(moved):
        raise NotIdentifiableError(
            f"{100.0 * min(moved) / sum(moved):.1f} % of the charge moves against the main direction; from "
            f"{100.0 * _MIN_COUNTER_CHARGE:g} % on hysteresis can be told from the open-circuit curve. Charge and "
            "discharge at the same states of charge, or fit an equivalent circuit without hysteresis"
        )


def _joined(grid: list[GridRun], soc: list[FloatArray], dt_s: float, cell: CellContext) -> Samples:
    lengths = [len(run) for run in grid]
    first = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64)
    voltage = np.concatenate([run.voltage_V for run in grid])
    temperature = [run.temperature_degC for run in grid]
    known = not any(np.isnan(column).any() for column in temperature)
    starts = np.array([f + s for f, run in zip(first, grid, strict=True) for s in run.segment_starts], dtype=np.int64)
    fold, n_folds = _folds(lengths, voltage)
    return Samples(
        current_A=np.concatenate([run.current_A for run in grid]),
        soc=np.concatenate(soc),
        temperature_degC=np.concatenate(temperature) if known else np.full(len(voltage), np.nan),
        voltage_V=voltage,
        starts=starts,
        run_starts=first,
        fold=fold,
        n_folds=n_folds,
        dt_s=dt_s,
        longest_s=dt_s * (max(lengths) - 1),
        cell=cell,
        names=[run.name for run in grid],
    )


def _folds(lengths: list[int], voltage: FloatArray) -> tuple[np.ndarray, int]:
    """Fold of each sample after `models.network.folds`; -1 where no voltage was measured."""
    run_index = np.repeat(np.arange(len(lengths)), lengths)
    group = holdout.group_numbers(run_index, None)
    fold_of_group = np.empty(int(group.max()) + 1, dtype=np.int64)
    held = holdout.folds(len(fold_of_group))
    for number, members in enumerate(held):
        fold_of_group[members] = number
    return np.where(np.isnan(voltage), -1, fold_of_group[group]), len(held)


def _check(samples: Samples) -> None:
    known = int((samples.fold >= 0).sum())
    if known < _MIN_SAMPLES:
        raise NotIdentifiableError(
            f"{known} usable samples at {samples.dt_s:g} s; at least {_MIN_SAMPLES} are needed. Record a longer run"
        )
    largest_A, rest_A = float(np.abs(samples.current_A).max()), samples.cell.rest_A
    if largest_A <= rest_A:
        raise NotIdentifiableError(f"the current never exceeds {rest_A:g} A: no resistance can be seen. Record pulses")
    steps = int((np.abs(np.diff(samples.current_A)) > 0.02 * largest_A).sum())
    if steps < _MIN_STEPS:
        raise NotIdentifiableError(
            f"the current changes only {steps} times: resistances and time constants cannot be told from the "
            "open-circuit curve at constant current. Record pulses and rests"
        )
    low, high = float(samples.soc.min()), float(samples.soc.max())
    if high - low < _MIN_SOC_RANGE:
        raise NotIdentifiableError(
            f"the state of charge stays within {low:.3f}..{high:.3f}: no open-circuit curve can be seen. "
            f"Record over at least {_MIN_SOC_RANGE:g} of the capacity"
        )
    if low < -0.2 or high > 1.2:
        raise NotIdentifiableError(
            f"counted state of charge runs from {low:.2f} to {high:.2f} with a capacity of "
            f"{samples.cell.capacity_Ah:g} Ah: capacity, initial state of charge or the unit of the current is wrong"
        )
