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
from models.data.timeseries import TimeSeries
from models.diagnosis import memory_of, memory_to_json, own_variant
from models.identification.excitation import fit_reservations
from models.identification.progress import Progress, part_of, silent
from models.network.lineage import document_sha256, with_version
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Json
from models.pipeline.choosing import Chosen, choose
from models.pipeline.plans import BoundedNetwork, Built, expected_V
from models.pipeline.request import FitOptions, FitRequest, in_step, without_repeats
from models.pipeline.request.lost_current import with_lost_currents
from models.pipeline.run_starts import likely_starts, with_starts
from models.pipeline.training import Training, training
from models.pipeline.usability.judge import judged_model
from models.readouts.possible_cell import made_possible
from models.readouts.rest_start import check_start_known, known_starts
from models.readouts.tables import read_out
from models.thermal.cell_temperature import thermal_record

# Likelier states of charge are taken where they lower the error on unseen runs to this share of it. On eight foreign
# cells that were stated to half a point, 0.4 to 0.8 went with a better simulation of further logs.
_LIKELY_WORTH = 0.8


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
    expected_rmse_mV : error on runs that a fit of these choices did not see
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
    expected_rmse_mV: float
    candidates: list[Json]
    n_samples: int
    seconds: float
    initial_soc: list[float]

    @property
    def compared(self) -> list[Json]:
        """Kinds of networks that were held against each other, with their errors on unseen runs."""
        return (self.network.record.choices or {}).get("compared", [])

    @property
    def terms(self) -> list[Json]:
        """What a bounded network is made of: of each signal its effects and the largest voltage that it makes."""
        return (self.network.record.choices or {}).get("terms", [])


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
    given = without_repeats(request)
    taken = in_step(given.request)
    data, chosen, built = _placed(taken.request, report)
    choices = _choices(built, chosen, len(data.grid))
    network = _noting(_read_out(built, data, report), choices=choices, effects=taken.effects)
    judged = _judged(network, data, request)
    network = _with_figures(network, data, built, judged)
    remarks = (*given.remarks, *taken.remarks)
    network = _noting(network, usability=judged_model(network, data, judged.train, judged.validation, remarks))
    report(0.97, "noting what a diagnosis will need")
    network = _versioned(_with_memory(network, data), data, given.request, judged)
    report(1.0, "done")
    return FitResult(
        network=network,
        train=judged.train,
        validation=judged.validation,
        train_runs=[judged.train_runs[k] for k in dict.fromkeys(given.place)],
        validation_runs=judged.validation_runs,
        candidates=chosen.plan.table,
        expected_rmse_mV=choices["expected_rmse_mV"],
        n_samples=data.n_samples,
        seconds=time.perf_counter() - started,
        initial_soc=[data.soc[k] for k in given.place],
    )


def _placed(request: FitRequest, report: Progress) -> tuple[Training, Chosen, Built]:
    """Training data with the starts of the runs, what was chosen for them, and the network of it."""
    data = training(request.train, request.capacity_Ah, request.initial_soc, request.dt_s, request.coulombic_efficiency)
    for run in request.validate or () if not request.validate_soc else ():
        check_start_known(run, data.cell.rest_A)
    automatic = request.structure == "auto"
    without, finer = request.without, request.finer
    simplest = "bounded" if automatic else request.structure
    first = choose(data, simplest, without, part_of(report, 0.0, 0.3), finer=finer)

    def again(placed: Training) -> Built:
        return first.plan.build(placed, silent)

    logged = data
    data, _ = with_lost_currents(data, first.built, again)
    if data is not logged:
        # What was chosen with currents that are wrong here and there may be richer, or poorer, than the cell.
        first = choose(data, simplest, without, silent, finer=finer)
    report(0.3, "looking where the runs begin")
    stated = data.starts
    data, built = with_starts(data, first.built, again, request.initial_soc_std)
    placed = first if data.starts == stated else None
    if request.initial_soc_std > 0.0 and isinstance(built, BoundedNetwork):
        likely = _likely_placed(data, placed or Chosen(first.plan, built, built.held_out()), request, report)
        data, placed = likely or (data, placed)
    if placed is not None and not automatic:
        return data, placed, placed.built
    # What was chosen with runs in the wrong places may be richer than what explains them in the right ones.
    chosen = choose(data, request.structure, without, part_of(report, 0.35, 0.5), placed, finer)
    return data, chosen, chosen.built


def _likely_placed(
    data: Training, known: Chosen, request: FitRequest, report: Progress
) -> tuple[Training, Chosen] | None:
    """Training data and network with likelier states of charge, where these simulate unseen runs better by far."""
    trial = likely_starts(data, known.built.network, request.initial_soc_std)
    if trial is None:
        return None
    again = choose(trial, "bounded", request.without, part_of(report, 0.3, 0.05), finer=request.finer)
    return (trial, again) if again.held_out.rmse_V <= _LIKELY_WORTH * known.held_out.rmse_V else None


def _choices(built: Built, chosen: Chosen, n_runs: int) -> Json:
    """What was chosen, with the error to be expected and the rivals."""
    expected_mV = 1e3 * expected_V(built, chosen.held_out, n_runs)
    choices = (built.network.record.choices or {}) | {"expected_rmse_mV": expected_mV}
    form = {"bounded": chosen.bounded.to_json()} if chosen.bounded is not None else {}
    return choices | ({"compared": chosen.compared} if chosen.compared else {}) | form


def _read_out(built: Built, data: Training, report: Progress) -> LocalModelNetwork:
    """What the network does not know, then its tables with their bands, then the heat balance that needs them."""
    report(0.9, "estimating what the model does not know")
    uncertainty, network = built.uncertainty(), built.network
    if not isinstance(built, BoundedNetwork):
        network = made_possible(network, uncertainty.parameters.theta_factor)
    network = _noting(network, uncertainty=uncertainty.to_json())
    report(0.95, "reading out tables")
    network = _noting(network, tables=dict(read_out(network)))
    heat = thermal_record(network, data.grid, data.soc)
    return _noting(network, thermal=None if heat is None else dict(heat))


def _judged(network: LocalModelNetwork, data: Training, request: FitRequest) -> _Judged:
    """Free run of the training runs, and of those that only judge."""
    compared = [beside(network, run, start) for run, start in zip(data.grid, data.starts, strict=True)]
    residuals = [{"run": c.run.name, **residual_statistics(c.residual_V, data.dt_s)} for c in compared]
    train, train_runs = _figures(compared)
    validation, validation_runs = None, []
    if request.validate:
        # How far a rest tells the state of charge depends on the error of the model.
        starts = known_starts(request.validate, request.validate_soc, _noting(network, train=train))
        soc, std = zip(*starts, strict=True)
        placed = zip(place_runs(network, request.validate, list(soc)), std, strict=True)
        validation, validation_runs = _figures([replace(c, start=replace(c.start, soc_std=s)) for c, s in placed])
    return _Judged(train, validation, train_runs, validation_runs, residuals)


def _with_figures(network: LocalModelNetwork, data: Training, built: Built, judged: _Judged) -> LocalModelNetwork:
    found = fit_reservations(judged.train, data.n_missing, data.n_samples)
    sums = built.sums()
    return _noting(
        network,
        residuals=tuple(judged.residuals),
        train=judged.train,
        validation=judged.validation,
        reservations=(*network.record.reservations, *found),
        sums=None if sums is None else sums.to_json(),
    )


def _with_memory(network: LocalModelNetwork, data: Training) -> LocalModelNetwork:
    """With what a diagnosis needs to know of the training runs, where they can carry its reference model.

    Of the runs as they were measured: what is supposed to have flowed before them is for the fit, and where runs begin
    is open to the memory anyway. It is what a diagnosis would find that is given the same runs.
    """
    try:
        memory = memory_of(data.grid, data.soc, data.cell.capacity_Ah, own_variant(network, data.grid))
    except (ModelError, np.linalg.LinAlgError):
        return network
    return _noting(network, diagnosis=memory_to_json(memory))


def _versioned(network: LocalModelNetwork, data: Training, given: FitRequest, judged: _Judged) -> LocalModelNetwork:
    sums = network.record.sums
    return with_version(
        network,
        "fit",
        given.train,
        settings={
            "structure": network.structure.name,
            "capacity_Ah": data.cell.capacity_Ah,
            "coulombic_efficiency": data.cell.efficiency,
            "dt_s": data.dt_s,
            "initial_soc": [start.to_json() for start in data.starts],
        },
        errors={"train": judged.train, "validation": judged.validation},
        code_version=given.code_version,
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
