"""From measured runs to a network: grid, choices, construction, refinement, and what the model says of itself."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from models.comparison.placed_runs import place_runs
from models.comparison.residuals import residual_statistics
from models.comparison.simulated_runs import RunComparison, beside
from models.data.errors import ModelError
from models.data.metrics import Metrics, RunMetrics, metrics
from models.data.start_soc import start_soc
from models.data.timeseries import FloatArray, TimeSeries
from models.diagnosis import memory_of
from models.identification.excitation import fit_reservations
from models.identification.output_error import normal_equations
from models.identification.progress import Progress, part_of, silent
from models.identification.refinement import Refined, refined_theta
from models.identification.search.candidate import Choice
from models.identification.search.fitted import Fitted
from models.identification.search.search import Search
from models.identification.stored_sums import StoredSums
from models.network.lineage import document_sha256, with_version
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Json, ModelRecord
from models.network.structure import Structure
from models.pipeline.fit_request import FitOptions, FitRequest
from models.pipeline.run_starts import with_starts
from models.pipeline.training import Training, training
from models.readouts.tables import read_out
from models.thermal.cell_temperature import thermal_record
from models.uncertainty.held_out import fit_uncertainty

STRUCTURES = ("full", "minimal", "auto")
# Parts that a fitted model's document names even where they say nothing.
_STATED = frozenset({"reservations", "thermal", "validation", "noise_floor_mV"})


class RunFigures(RunMetrics):
    """Free-run figures of one run.

    `outside_training`: share of its samples outside the trained domain; `initial_soc`: where it begins, with a standard
    deviation where it was estimated.
    """

    outside_training: float
    initial_soc: dict[str, float | None]


@dataclass(frozen=True)
class FitResult:
    """A fitted network and how well it simulates.

    Attributes
    ----------
    network : the model
    train, validation : free-run figures; `validation` is None where no run was held out
    train_runs, validation_runs : the same for each run
    candidates : documents of every set of choices that was tried, with its held-out error
    n_samples : training samples on the model's grid
    seconds : time the fit took
    initial_soc : where each training run begins: as stated, or as it was estimated
    """

    network: LocalModelNetwork
    train: Metrics
    validation: Metrics | None
    train_runs: list[RunFigures]
    validation_runs: list[RunFigures]
    candidates: list[Json]
    n_samples: int
    seconds: float
    initial_soc: list[float]


@dataclass(frozen=True)
class _Built:
    """A network of a choice, as yet without what it says of itself."""

    fitted: Fitted
    refined: Refined
    network: LocalModelNetwork


@dataclass(frozen=True)
class _Judged:
    """Free-run figures, overall and by run; of the training runs also the statistics of their error."""

    train: Metrics
    validation: Metrics | None
    train_runs: list[RunFigures]
    validation_runs: list[RunFigures]
    residuals: list[Json]


def fit_network(train: list[TimeSeries], *, capacity_Ah: float, **options: Unpack[FitOptions]) -> FitResult:
    """Identify a local model network.

    Parameters
    ----------
    train : runs that the model is made from
    capacity_Ah : cell capacity
    **options : further fields of `FitRequest`, such as `structure` ("full") and `validate`

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
    return fit(FitRequest(train=train, capacity_Ah=capacity_Ah, **options))


def fit(request: FitRequest) -> FitResult:
    """Identify the network that a request asks for; see `fit_network`."""
    started = time.perf_counter()
    report = request.progress or silent
    data = training(request.train, request.capacity_Ah, request.initial_soc, request.dt_s, request.coulombic_efficiency)
    search = Search(data.fit_grid, data.fit_soc, data.cell, part_of(report, 0.0, 0.7))
    choice = _chosen(search, request.structure)
    report(0.7, f"building {choice.n_models} local models")
    built = _built(search, choice, data, part_of(report, 0.7, 0.15))
    report(0.85, "looking where the runs begin")

    def again(placed: Training) -> _Built:
        return _built(Search(placed.fit_grid, placed.fit_soc, placed.cell, silent), choice, placed, silent, search)

    data, built = with_starts(data, built, again, lambda made: made.network, request.initial_soc_std)
    network = _read_out(built.network, data, built.fitted, built.refined, report)
    judged = _judged(network, data, request)
    network = _with_figures(network, data, built.fitted, judged)
    report(0.97, "noting what a diagnosis will need")
    network = _versioned(_with_memory(network, data), data, judged, request.code_version)
    report(1.0, "done")
    return FitResult(
        network=network,
        train=judged.train,
        validation=judged.validation,
        train_runs=judged.train_runs,
        validation_runs=judged.validation_runs,
        candidates=search.table,
        n_samples=data.n_samples,
        seconds=time.perf_counter() - started,
        initial_soc=data.soc,
    )


def _chosen(search: Search, structure: str | Structure) -> Choice:
    if isinstance(structure, Structure):
        return search.best_within(structure)
    if structure not in STRUCTURES:
        raise ModelError(f"structure {structure!r} is unknown; use one of {', '.join(STRUCTURES)}")
    return search.best(structure)


def _built(search: Search, choice: Choice, data: Training, report: Progress, searched: Search | None = None) -> _Built:
    """Fit a choice; `searched`: where it was chosen, if not here."""
    fitted = search.fitted(choice)
    refined = refined_theta(fitted, report)
    table = (search if searched is None else searched).table
    return _Built(fitted, refined, _bare(data, choice, table, fitted, refined))


def _bare(
    data: Training, choice: Choice, candidates: list[Json], fitted: Fitted, refined: Refined
) -> LocalModelNetwork:
    """The network with a record of its data and choices."""
    record = ModelRecord(
        domain=data.domain,
        train_runs=tuple(run.name for run in data.runs),
        choices=choice.to_json() | {"log_strengths": list(fitted.fit.log_strengths)},
        candidates=tuple(candidates),
        reservations=tuple(data.reservations),
        refinement=dict(refined.record),
        noise_floor_mV=data.noise_floor_mV,
        stated=_STATED,
    )
    return LocalModelNetwork(fitted.structure, fitted.partition, refined.theta, fitted.scaling, data.cell, record)


def _read_out(
    network: LocalModelNetwork, data: Training, fitted: Fitted, refined: Refined, report: Progress
) -> LocalModelNetwork:
    """What the network does not know, then its tables with their bands, then the heat balance that needs them."""
    report(0.9, "estimating what the model does not know")
    uncertainty = fit_uncertainty(fitted, refined.theta, refined.penalties, refined.held_out)
    network = _noting(network, uncertainty=uncertainty.to_json())
    report(0.95, "reading out tables")
    network = _noting(network, tables=dict(read_out(network)))
    heat = thermal_record(network, data.grid, data.soc)
    return _noting(network, thermal=None if heat is None else dict(heat))


def _judged(network: LocalModelNetwork, data: Training, request: FitRequest) -> _Judged:
    """Free run of the training runs, and of those that only judge."""
    compared = [beside(network, run, start) for run, start in zip(data.grid, data.starts, strict=True)]
    residuals = [{"run": c.run.name, **residual_statistics(-c.residual_V, data.dt_s)} for c in compared]
    train, train_runs = _figures(compared)
    validation, validation_runs = None, []
    if request.validate:
        soc = request.validate_soc or [start_soc(run) for run in request.validate]
        validation, validation_runs = _figures(place_runs(network, request.validate, soc))
    return _Judged(train, validation, train_runs, validation_runs, residuals)


def _with_figures(network: LocalModelNetwork, data: Training, fitted: Fitted, judged: _Judged) -> LocalModelNetwork:
    found = fit_reservations(judged.train, data.n_missing, data.n_samples)
    return _noting(
        network,
        residuals=tuple(judged.residuals),
        train=judged.train,
        validation=judged.validation,
        reservations=(*network.record.reservations, *found),
        sums=_sums(fitted, network.theta).to_json(),
    )


def _sums(fitted: Fitted, theta: FloatArray) -> StoredSums:
    """What the training runs say of the parameters, for a later fit to new runs alone."""
    if fitted.structure.output_order == 0:
        xx, xy, yy = fitted.sums.xx.sum(axis=0), fitted.sums.xy.sum(axis=0), float(fitted.sums.yy.sum())
        b = theta.ravel()
        return StoredSums(xx, float(fitted.sums.count.sum()), max(float(yy - 2.0 * b @ xy + b @ xx @ b), 0.0))
    equations = normal_equations(theta, fitted.structure.output_order, fitted.partition, fitted.data)
    return StoredSums(equations.information, equations.weight, equations.squared_error)


def _with_memory(network: LocalModelNetwork, data: Training) -> LocalModelNetwork:
    """With what a diagnosis needs to know of the training runs, where they can carry its reference model."""
    try:
        memory = memory_of(data.grid, data.soc, data.cell.capacity_Ah)
    except (ModelError, np.linalg.LinAlgError):
        return network
    return _noting(network, diagnosis=memory.to_json())


def _versioned(network: LocalModelNetwork, data: Training, judged: _Judged, code_version: str) -> LocalModelNetwork:
    sums = network.record.sums
    return with_version(
        network,
        "fit",
        data.runs,
        settings={
            "structure": network.structure.name,
            "capacity_Ah": data.cell.capacity_Ah,
            "coulombic_efficiency": data.cell.efficiency,
            "dt_s": data.dt_s,
            "initial_soc": [start.to_json() for start in data.starts],
        },
        errors={"train": judged.train, "validation": judged.validation},
        code_version=code_version,
        sums_sha256=None if sums is None else document_sha256(sums),
    )


def _noting(network: LocalModelNetwork, **parts: Any) -> LocalModelNetwork:
    return replace(network, record=replace(network.record, **parts))


def _figures(compared: list[RunComparison]) -> tuple[Metrics, list[RunFigures]]:
    each: list[RunFigures] = [
        {
            "run": c.run.name,
            **metrics(c.run.voltage_V, c.simulated_V),
            "outside_training": float(1.0 - c.inside.mean()),
            "initial_soc": c.start.to_json(),
        }
        for c in compared
    ]
    overall = metrics(
        np.concatenate([c.run.voltage_V for c in compared]), np.concatenate([c.simulated_V for c in compared])
    )
    return overall, each
