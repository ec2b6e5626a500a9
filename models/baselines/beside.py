"""Baselines fitted to a model's training runs and judged on the runs that the model is judged on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypedDict

import numpy as np

from models.baselines.enhanced_self_correcting import fit_enhanced_self_correcting
from models.baselines.equivalent_circuit import fit_equivalent_circuit
from models.comparison.placed_runs import place_runs
from models.data.errors import ModelError
from models.data.metrics import Metrics, RunMetrics, metrics
from models.data.timeseries import TimeSeries
from models.network.cell_model import CellModel

Fit = Callable[[list[TimeSeries], list[float], float, float], CellModel]


class BaselineFigures(TypedDict):
    """One baseline's free-run error on the compared runs."""

    name: str
    overall: Metrics
    runs: list[RunMetrics]


def _circuit(n_branches: int) -> Fit:
    def fit(runs: list[TimeSeries], soc: list[float], capacity_Ah: float, dt_s: float) -> CellModel:
        return fit_equivalent_circuit(runs, capacity_Ah=capacity_Ah, n_branches=n_branches, initial_soc=soc, dt_s=dt_s)

    return fit


def _self_correcting(runs: list[TimeSeries], soc: list[float], capacity_Ah: float, dt_s: float) -> CellModel:
    return fit_enhanced_self_correcting(runs, capacity_Ah=capacity_Ah, initial_soc=soc, dt_s=dt_s)


# Circuits with one and two pairs of resistor and capacitor, and Plett's enhanced self-correcting cell.
BASELINES: dict[str, Fit] = {"1rc": _circuit(1), "2rc": _circuit(2), "esc": _self_correcting}


def beside_baselines(
    model: CellModel,
    names: Sequence[str],
    train: tuple[list[TimeSeries], list[float]],
    judged: tuple[list[TimeSeries], list[float]],
) -> list[BaselineFigures]:
    """Fit baselines and judge them as a model is judged.

    Parameters
    ----------
    model : gives capacity and sampling time
    names : of BASELINES
    train : runs that the model was made from, with the fraction at which each starts
    judged : runs to be compared, with the same

    Raises
    ------
    ModelError
        A baseline is not known, or no training run is given.
    """
    unknown = [name for name in names if name not in BASELINES]
    if unknown:
        raise ModelError(f"baseline {unknown[0]!r} is not known; use one of {', '.join(BASELINES)}")
    if not train[0]:
        raise ModelError("a baseline is fitted to the runs that the model was made from: name them as training runs")
    return [_judged(name, BASELINES[name](*train, model.cell.capacity_Ah, model.dt_s), *judged) for name in names]


def _judged(name: str, baseline: CellModel, runs: list[TimeSeries], soc: list[float]) -> BaselineFigures:
    placed = place_runs(baseline, runs, soc)
    measured = np.concatenate([each.run.voltage_V for each in placed])
    simulated = np.concatenate([each.simulated_V for each in placed])
    figures: list[RunMetrics] = [
        {"run": each.run.name, **metrics(each.run.voltage_V, each.simulated_V)} for each in placed
    ]
    return {"name": name, "overall": metrics(measured, simulated), "runs": figures}
