"""From measured runs to a network: grid, choices, construction, refinement, and what the model says of itself."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.comparison import inside_domain, simulate_runs
from models.errors import ModelError, NotIdentifiableError
from models.local_model_network import LocalModelNetwork
from models.metrics import Metrics, metrics, noise_floor_V
from models.refinement import refined_theta
from models.regression import CellContext
from models.resampling import GridRun, to_grid, typical_interval_s
from models.signals import REST_C_RATE, soc_by_counting
from models.structure import Structure
from models.structure_search import Choice, Progress, Search
from models.timeseries import TimeSeries

STRUCTURES = ("full", "minimal", "auto")
_MIN_SAMPLES = 200


@dataclass(frozen=True)
class FitResult:
    """A fitted network and how well it simulates.

    Attributes
    ----------
    network : the model
    train, validation : free-run figures; `validation` is None where no run was held out
    train_runs, validation_runs : the same for each run
    candidates : every set of choices that was tried, with its held-out error
    n_samples : training samples on the model's grid
    seconds : time the fit took
    """

    network: LocalModelNetwork
    train: Metrics
    validation: Metrics | None
    train_runs: list[dict[str, Any]]
    validation_runs: list[dict[str, Any]]
    candidates: list[dict[str, Any]]
    n_samples: int
    seconds: float


def fit_network(
    train: list[TimeSeries],
    *,
    capacity_Ah: float,
    structure: str | Structure = "full",
    validate: list[TimeSeries] | None = None,
    initial_soc: list[float] | None = None,
    validate_soc: list[float] | None = None,
    dt_s: float | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Identify a local model network.

    Parameters
    ----------
    train : runs that the model is made from
    capacity_Ah : cell capacity
    structure : "full", "minimal", "auto", or a structure of one's own, which is kept
    validate : runs that only judge the result
    initial_soc, validate_soc : fraction at the start of each run; by default its first `soc_ref`
    dt_s : sampling time; by default the typical interval of the training runs
    progress : called with a share 0..1 and a short text

    Returns
    -------
    FitResult

    Raises
    ------
    NotIdentifiableError
        The data cannot determine the model; the message names what is missing in physical words.
    ModelError
        Bad capacity, no run, or no initial SoC.
    """
    started = time.perf_counter()
    report = progress or (lambda share, text: None)
    if not train:
        raise ModelError("no training run was given")
    if not (np.isfinite(capacity_Ah) and capacity_Ah > 0.0):
        raise ModelError(f"capacity is {capacity_Ah:g} Ah; it must be positive")
    step_s = dt_s if dt_s is not None else typical_interval_s(train)
    grid = [to_grid(run, step_s) for run in train]
    soc = initial_soc or [start_soc(run) for run in train]
    cell = CellContext(capacity_Ah)
    _check_excitation(grid, soc, cell)
    search = Search(grid, soc, cell, lambda share, text: report(0.7 * share, text))
    chosen = _chosen(search, structure)
    report(0.7, f"building {chosen.n_models} local models")
    fitted = search.fitted(chosen)
    record: dict[str, Any] = {
        "domain": _domain(grid, soc, cell),
        "train_runs": [run.name for run in train],
        "choices": chosen.to_json() | {"log_strengths": list(fitted.fit.log_strengths)},
        "candidates": search.table,
    }
    theta, record["refinement"] = refined_theta(fitted, lambda share, text: report(0.7 + 0.3 * share, text))
    network = LocalModelNetwork(fitted.structure, fitted.partition, theta, fitted.scaling, cell, record)
    train_all, train_each = _figures(network, train, soc)
    validation_all, validation_each = None, []
    if validate:
        validation_soc = validate_soc or [start_soc(run) for run in validate]
        validation_all, validation_each = _figures(network, validate, validation_soc)
    record["train"] = train_all
    record["validation"] = validation_all
    floors = [noise_floor_V(run.voltage_V, run.current_A) for run in grid]
    known = [floor for floor in floors if np.isfinite(floor)]
    record["noise_floor_mV"] = 1e3 * float(np.median(known)) if known else None
    report(1.0, "done")
    return FitResult(
        network=network,
        train=train_all,
        validation=validation_all,
        train_runs=train_each,
        validation_runs=validation_each,
        candidates=search.table,
        n_samples=sum(len(run) for run in grid),
        seconds=time.perf_counter() - started,
    )


def _chosen(search: Search, structure: str | Structure) -> Choice:
    if isinstance(structure, Structure):
        return search.best_within(structure)
    if structure not in STRUCTURES:
        raise ModelError(f"structure {structure!r} is unknown; use one of {', '.join(STRUCTURES)}")
    return search.best(structure)


def start_soc(run: TimeSeries) -> float:
    """Return the first reference SoC of a run.

    Raises
    ------
    ModelError
        The run has none; the message says how to give one.
    """
    if run.soc_ref is not None:
        known = run.soc_ref[~np.isnan(run.soc_ref)]
        if len(known):
            return float(known[0])
    raise ModelError(f"{run.name}: its initial SoC is not known (no soc_ref column); give it with --initial-soc")


def _figures(
    network: LocalModelNetwork, runs: list[TimeSeries], soc: list[float]
) -> tuple[Metrics, list[dict[str, Any]]]:
    compared = simulate_runs(network, runs, soc)
    each = [
        {
            "run": c.run.name,
            **metrics(c.run.voltage_V, c.simulated_V),
            "outside_training": float(1.0 - inside_domain(network, c.run, c.soc).mean()),
        }
        for c in compared
    ]
    overall = metrics(
        np.concatenate([c.run.voltage_V for c in compared]), np.concatenate([c.simulated_V for c in compared])
    )
    return overall, each


def _domain(grid: list[GridRun], soc: list[float], cell: CellContext) -> dict[str, list[float]]:
    """Ranges of SoC, current and temperature in the training runs."""
    counted = [soc_by_counting(run.charge_Ah, s, cell.capacity_Ah) for run, s in zip(grid, soc, strict=True)]
    domain = {
        "soc": _range(counted),
        "current_A": _range([run.current_A for run in grid]),
    }
    if not any(np.isnan(run.temperature_degC).any() for run in grid):
        domain["temperature_degC"] = _range([run.temperature_degC for run in grid])
    return domain


def _range(parts: list[Any]) -> list[float]:
    return [float(min(p.min() for p in parts)), float(max(p.max() for p in parts))]


def _check_excitation(grid: list[GridRun], soc: list[float], cell: CellContext) -> None:
    """Refuse data that cannot determine any model."""
    known = sum(int(run.measured.sum()) for run in grid)
    if known < _MIN_SAMPLES:
        raise NotIdentifiableError(
            f"{known} usable samples at {grid[0].dt_s:g} s; at least {_MIN_SAMPLES} are needed. Record a longer run"
        )
    current = np.concatenate([run.current_A for run in grid])
    if float(np.abs(current).max()) <= REST_C_RATE * cell.capacity_Ah:
        raise NotIdentifiableError(
            f"the current never exceeds {REST_C_RATE * cell.capacity_Ah:g} A: neither resistance nor open-circuit "
            "curve can be seen. Record pulses"
        )
    steps = np.abs(np.diff(current)) > 0.02 * float(np.abs(current).max())
    if int(steps.sum()) < 5:
        raise NotIdentifiableError(
            f"the current changes only {int(steps.sum())} times: the resistance cannot be told from the open-circuit "
            "curve at constant current. Record pulses and rests"
        )
    counted = [soc_by_counting(run.charge_Ah, s, cell.capacity_Ah) for run, s in zip(grid, soc, strict=True)]
    low, high = _range(counted)
    if low < -0.2 or high > 1.2:
        raise NotIdentifiableError(
            f"counted SoC runs from {low:.2f} to {high:.2f} with a capacity of {cell.capacity_Ah:g} Ah: "
            "capacity, initial SoC or the unit of the current is wrong"
        )
