"""Model against measurement: how large the error is, and where it lies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.cell_model import CellModel
from models.cell_temperature import compare_temperature
from models.comparison_reach import band_figures, bands, gaps, inside_by
from models.errors import ModelError
from models.local_model_network import LocalModelNetwork
from models.metrics import metrics, noise_floor_V
from models.resampling import GridRun, to_grid
from models.signals import held_sign, soc_by_counting
from models.timeseries import FloatArray, TimeSeries

_SOC_EDGES = np.linspace(0.0, 1.0, 11)
_C_RATE_EDGES = np.array([-np.inf, -3.0, -2.0, -1.0, -0.5, -0.005, 0.005, 0.5, 1.0, 2.0, 3.0, np.inf])
_TEMPERATURE_STEP_K = 5.0
_MIN_COMPARED = 10


@dataclass(frozen=True)
class RunComparison:
    """One run beside its free run, on the model's grid.

    Attributes
    ----------
    run : the measurement
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
    """Free run of each measured run."""
    results = []
    for series, soc0 in zip(runs, initial_soc, strict=True):
        run = to_grid(series, network.dt_s)
        soc = soc_by_counting(run.charge_Ah, soc0, network.cell.capacity_Ah, network.cell.efficiency)
        results.append(RunComparison(run, network.free_run_V(run, soc0), soc, inside_domain(network, run, soc)))
    return results


def compare(network: CellModel, runs: list[TimeSeries], initial_soc: list[float]) -> dict[str, Any]:
    """Free-run error overall, of each run, and by SoC, current, temperature and direction.

    Parameters
    ----------
    network : the model
    runs : measurements that the fit may or may not have seen
    initial_soc : fraction 0..1 of each run

    Returns
    -------
    The `compare` object of the public contract.
    """
    if not runs:
        raise ModelError("nothing to compare: no run was given")
    compared = simulate_runs(network, runs, initial_soc)
    grid = [c.run for c in compared]
    measured = np.concatenate([c.run.voltage_V for c in compared])
    simulated = np.concatenate([c.simulated_V for c in compared])
    _check_comparable(measured, simulated)
    floors = [noise_floor_V(c.run.voltage_V, c.run.current_A) for c in compared]
    known = [f for f in floors if not np.isnan(f)]
    inside = np.concatenate([c.inside for c in compared])
    return {
        "overall": metrics(measured, simulated),
        "runs": [{"run": c.run.name, **metrics(c.run.voltage_V, c.simulated_V)} for c in compared],
        "noise_floor_mV": 1e3 * float(np.median(known)) if known else None,
        "where": where(network, compared),
        "outside_training": float(1.0 - inside.mean()),
        "outside_by": _outside_by(network, compared),
        "gaps": [gaps(run) for run in grid],
        "band": band_figures(bands(network, grid, initial_soc), grid, [c.inside for c in compared]),
        "temperature": compare_temperature(network, grid, initial_soc)
        if isinstance(network, LocalModelNetwork)
        else None,
    }


def _outside_by(network: CellModel, compared: list[RunComparison]) -> dict[str, float]:
    """Share of the samples outside the trained range of each dimension."""
    parts = [inside_by(network, c.run, c.soc) for c in compared]
    return {name: float(1.0 - np.concatenate([part[name] for part in parts]).mean()) for name in parts[0]}


def _check_comparable(measured_V: FloatArray, simulated_V: FloatArray) -> None:
    """Refuse figures of almost nothing: a model that cannot be simulated must not look perfect."""
    known = ~np.isnan(measured_V)
    lost = int((known & ~np.isfinite(simulated_V)).sum())
    if lost:
        raise ModelError(
            f"the model gives no voltage at {lost} of {int(known.sum())} samples: temperature is missing there, or the "
            "model is not for this cell"
        )
    if int(known.sum()) < _MIN_COMPARED:
        raise ModelError(
            f"{int(known.sum())} samples have a voltage on the model's grid; at least {_MIN_COMPARED} are needed"
        )


def where(network: CellModel, compared: list[RunComparison]) -> list[dict[str, Any]]:
    """Share of the squared error and of the time by each variable, the largest density of error first."""
    error = np.concatenate([c.residual_V for c in compared])
    known = ~np.isnan(error)
    squared = np.where(known, error, 0.0) ** 2
    rows: list[dict[str, Any]] = []
    for variable, unit, values, edges in _variables(network, compared):
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            chosen = known & (values >= low) & (values < high)
            if not chosen.any():
                continue
            rows.append(
                {
                    "variable": variable,
                    "from": float(max(low, values[chosen].min())),
                    "to": float(min(high, values[chosen].max())),
                    "unit": unit,
                    "rmse_mV": 1e3 * float(np.sqrt(squared[chosen].mean())),
                    "share_of_squared_error": float(squared[chosen].sum() / max(squared.sum(), 1e-300)),
                    "share_of_time": float(chosen.sum() / known.sum()),
                }
            )
    return sorted(rows, key=lambda row: -row["rmse_mV"])


def inside_domain(network: CellModel, run: GridRun, soc: FloatArray) -> np.ndarray:
    """Whether each sample lies in the ranges of SoC, current and temperature that the model was trained on."""
    return np.logical_and.reduce([np.ones(len(run), dtype=bool), *inside_by(network, run, soc).values()])


def _variables(network: CellModel, compared: list[RunComparison]) -> list[tuple[str, str, FloatArray, FloatArray]]:
    current = np.concatenate([c.run.current_A for c in compared])
    soc = np.concatenate([c.soc for c in compared])
    temperature = np.concatenate([c.run.temperature_degC for c in compared])
    direction = np.concatenate([held_sign(c.run.current_A, network.cell.rest_A) for c in compared])
    soc_edges = np.concatenate([[-np.inf], _SOC_EDGES[1:-1], [np.inf]])
    variables = [
        ("soc", "1", soc, soc_edges),
        ("current_A", "A", current, _C_RATE_EDGES * network.cell.capacity_Ah),
        ("direction", "sign", direction, np.array([-1.5, 0.0, 1.5])),
    ]
    if not np.isnan(temperature).all():
        low = np.floor(np.nanmin(temperature) / _TEMPERATURE_STEP_K) * _TEMPERATURE_STEP_K
        edges = np.arange(low, np.nanmax(temperature) + _TEMPERATURE_STEP_K, _TEMPERATURE_STEP_K)
        variables.append(("temperature_degC", "degC", temperature, np.append(edges, np.inf)))
    return variables
