"""From measured runs to a network: grid, choices, construction, refinement, and what the model says of itself."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.comparison.residuals import residual_statistics
from models.comparison.simulated_runs import RunComparison, simulate_runs
from models.data.errors import ModelError
from models.data.metrics import Metrics, metrics, noise_floor_V
from models.data.resampling import GridRun, to_grid, typical_interval_s
from models.data.start_soc import start_soc
from models.data.timeseries import FloatArray, TimeSeries
from models.identification.excitation import check_excitation, check_series, fit_reservations
from models.identification.output_error import normal_equations
from models.identification.refinement import refined_theta
from models.identification.search.search import Choice, Fitted, Progress, Search
from models.identification.stored_sums import StoredSums
from models.network.lineage import document_sha256, with_version
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import CellContext
from models.network.signals import soc_by_counting
from models.network.structure import Structure
from models.readouts.tables import read_out
from models.thermal.cell_temperature import thermal_record
from models.uncertainty.held_out import fit_uncertainty

STRUCTURES = ("full", "minimal", "auto")


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
    code_version: str = "unknown",
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
    code_version : of the program, for the record

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
    soc = initial_soc or [start_soc(run) for run in train]
    cell = CellContext(capacity_Ah)
    reservations = check_series(train, step_s, capacity_Ah)
    grid = [to_grid(run, step_s) for run in train]
    reservations += check_excitation(grid, soc, cell)
    search = Search(grid, soc, cell, lambda share, text: report(0.7 * share, text))
    chosen = _chosen(search, structure)
    report(0.7, f"building {chosen.n_models} local models")
    fitted = search.fitted(chosen)
    record: dict[str, Any] = {
        "domain": _domain(grid, soc, cell),
        "train_runs": [run.name for run in train],
        "choices": chosen.to_json() | {"log_strengths": list(fitted.fit.log_strengths)},
        "candidates": search.table,
        "reservations": reservations,
    }
    refined = refined_theta(fitted, lambda share, text: report(0.7 + 0.2 * share, text))
    record["refinement"] = refined.record
    network = LocalModelNetwork(fitted.structure, fitted.partition, refined.theta, fitted.scaling, cell, record)
    report(0.9, "estimating what the model does not know")
    uncertainty = fit_uncertainty(fitted, refined.theta, refined.penalties, refined.held_out)
    record["uncertainty"] = uncertainty.to_json()
    report(0.95, "reading out tables")
    record["tables"] = read_out(network)
    record["thermal"] = thermal_record(network, grid, soc)
    compared = simulate_runs(network, train, soc)
    record["residuals"] = [{"run": c.run.name, **residual_statistics(-c.residual_V, step_s)} for c in compared]
    train_all, train_each = _figures(compared)
    validation_all, validation_each = None, []
    if validate:
        validation_soc = validate_soc or [start_soc(run) for run in validate]
        validation_all, validation_each = _figures(simulate_runs(network, validate, validation_soc))
    record["train"] = train_all
    n_samples = sum(len(run) for run in grid)
    reservations += fit_reservations(train_all, sum(run.n_missing for run in grid), n_samples)
    record["validation"] = validation_all
    floors = [noise_floor_V(run.voltage_V, run.current_A) for run in grid]
    known = [floor for floor in floors if np.isfinite(floor)]
    record["noise_floor_mV"] = 1e3 * float(np.median(known)) if known else None
    record["sums"] = _sums(fitted, refined.theta).to_json()
    report(0.97, "noting what a diagnosis will need")
    record |= _memory(grid, soc, capacity_Ah)
    network = with_version(
        network,
        "fit",
        train,
        settings={"structure": fitted.structure.name, "capacity_Ah": capacity_Ah, "dt_s": step_s},
        errors={"train": train_all, "validation": validation_all},
        code_version=code_version,
        sums_sha256=document_sha256(record["sums"]),
    )
    report(1.0, "done")
    return FitResult(
        network=network,
        train=train_all,
        validation=validation_all,
        train_runs=train_each,
        validation_runs=validation_each,
        candidates=search.table,
        n_samples=n_samples,
        seconds=time.perf_counter() - started,
    )


def _memory(grid: list[GridRun], soc: list[float], capacity_Ah: float) -> dict[str, Any]:
    """What a diagnosis needs to know of the training runs; empty where they cannot carry its reference model."""
    # Here and not above: a diagnosis fits networks again, so its modules need this one first.
    from models.diagnosis import MEMORY, memory_of

    try:
        return {MEMORY: memory_of(grid, soc, capacity_Ah).to_json()}
    except (ModelError, np.linalg.LinAlgError):
        return {}


def _sums(fitted: Fitted, theta: FloatArray) -> StoredSums:
    """What the training runs say of the parameters, for a later fit to new runs alone."""
    if fitted.structure.output_order == 0:
        xx, xy, yy = fitted.sums.xx.sum(axis=0), fitted.sums.xy.sum(axis=0), float(fitted.sums.yy.sum())
        b = theta.ravel()
        return StoredSums(xx, float(fitted.sums.count.sum()), max(float(yy - 2.0 * b @ xy + b @ xx @ b), 0.0))
    equations = normal_equations(theta, fitted.structure.output_order, fitted.partition, fitted.data)
    return StoredSums(equations.information, equations.weight, equations.squared_error)


def _chosen(search: Search, structure: str | Structure) -> Choice:
    if isinstance(structure, Structure):
        return search.best_within(structure)
    if structure not in STRUCTURES:
        raise ModelError(f"structure {structure!r} is unknown; use one of {', '.join(STRUCTURES)}")
    return search.best(structure)


def _figures(compared: list[RunComparison]) -> tuple[Metrics, list[dict[str, Any]]]:
    each = [
        {
            "run": c.run.name,
            **metrics(c.run.voltage_V, c.simulated_V),
            "outside_training": float(1.0 - c.inside.mean()),
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
