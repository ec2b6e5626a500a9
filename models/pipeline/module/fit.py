"""From runs of a module to its model: the mean cell's network, R and V_0 beside the cells, and the groups."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from models.comparison.placed_runs import place_runs
from models.data.errors import ModelError
from models.data.metrics import Metrics
from models.data.resampling import to_grid
from models.data.start_soc import start_soc
from models.identification.progress import Progress, part_of, silent
from models.module.groups import judge_groups, left_out, weak_group
from models.module.log import ModuleLog, series_of
from models.module.models import ModuleRun
from models.module.network import ModuleNetwork, ModuleRecord
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Json
from models.network.regression import CellContext
from models.network.structure import Structure
from models.pipeline.fit import FitResult, fit
from models.pipeline.module.choice import Candidate, candidates, chosen, figures
from models.pipeline.request.fit_request import FitRequest
from models.readouts.rest_start import check_start_known, known_starts


@dataclass(frozen=True, kw_only=True)
class ModuleFitRequest:
    """What is asked of the fit of a module.

    Attributes
    ----------
    train, validate : runs of the module; those of `validate` only judge
    capacity_Ah : of the whole module
    in_series, parallel : layout; `in_series` None: as many as have a voltage of their own
    cell : network of one cell, from tests of cells; None: identified from the module's mean cell
    initial_soc, validate_soc : fraction at the start of each run; see `FitRequest`
    structure, without, initial_soc_std, coulombic_efficiency, progress, code_version : see `FitRequest`
    """

    train: list[ModuleLog]
    capacity_Ah: float
    in_series: int | None = None
    parallel: int = 1
    validate: Sequence[ModuleLog] = ()
    cell: LocalModelNetwork | None = None
    initial_soc: list[float] | None = None
    validate_soc: list[float] | None = None
    structure: str | Structure = "auto"
    without: tuple[str, ...] = ()
    initial_soc_std: float = 0.0
    coulombic_efficiency: float = 1.0
    progress: Progress | None = None
    code_version: str = "unknown"


@dataclass(frozen=True)
class ModuleFit:
    """A module's model and how well it does.

    Attributes
    ----------
    model : with the module model that was chosen
    train, validation : free-run figures of the module's voltage; `validation` is None where no run was held out
    train_runs, validation_runs : the same for each run, with its name and where it begins
    expected_rmse_mV : error on runs that were not seen: R and V_0 from others, or the cells' own where that is larger
    n_samples : training samples on the model's grid
    seconds : time the fit took
    initial_soc : where each training run begins
    """

    model: ModuleNetwork
    train: Metrics
    validation: Metrics | None
    train_runs: list[Json]
    validation_runs: list[Json]
    expected_rmse_mV: float
    n_samples: int
    seconds: float
    initial_soc: list[float]

    def to_json(self) -> Json:
        """Return the `fit` object of the public contract, without paths; `module` holds what only modules have."""
        record, module = self.model.record, self.model.module
        return {
            "structure": self.model.network.structure.name,
            "n_samples": self.n_samples,
            "n_local_models": self.model.network.n_models,
            "seconds": round(self.seconds, 3),
            "train": self.train,
            "validation": self.validation,
            "expected_rmse_mV": self.expected_rmse_mV,
            "usability": record.usability,
            "runs": {"train": self.train_runs, "validation": self.validation_runs},
            "module": {
                "chosen": module.kind,
                "cells_in_series": module.cells_in_series,
                "cells_in_parallel": module.cells_in_parallel,
                "models": list(record.compared),
                "groups": list(record.groups),
                "weak_group": record.weak_group,
            },
            "reservations": list(record.reservations),
        }


def fit_module(request: ModuleFitRequest) -> ModuleFit:
    """Identify the model of a module.

    Raises
    ------
    NotIdentifiableError
        The data cannot determine the mean cell; the message names what is missing in physical words.
    ModelError
        No run, an unclear layout, or no initial SoC.
    """
    started, report = time.perf_counter(), request.progress or silent
    if not request.train:
        raise ModelError("no training run was given")
    layout = series_of([*request.train, *request.validate], request.in_series), request.parallel
    soc = request.initial_soc or [start_soc(log.run) for log in request.train]
    for log in request.validate if not request.validate_soc else ():
        check_start_known(log.run, CellContext(request.capacity_Ah).rest_A)
    fitted = None if request.cell is not None else _mean_cell(request, layout, soc, part_of(report, 0.0, 0.8))
    network = _given_cell(request) if fitted is None else fitted.network
    soc = soc if fitted is None else fitted.initial_soc
    report(0.85, "identifying the module models")
    train = _beside_cells(network, request.train, layout, soc)
    judged = known_starts([log.mean_cell(*layout) for log in request.validate], request.validate_soc, network)
    validate = _beside_cells(network, request.validate, layout, [value for value, _ in judged])
    rest_A = network.cell.rest_A * request.parallel
    found, reservations = candidates(train, validate, layout, rest_A)
    best = chosen(found)
    report(0.9, "looking at each group")
    groups = judge_groups(network, request.parallel, request.train, soc)
    record = ModuleRecord(
        usability=None if fitted is None else network.record.usability,
        reservations=(
            *reservations,
            *left_out(groups, request.train),
            *(() if fitted is None else network.record.reservations),
        ),
        train=best.train,
        validation=best.validation,
        compared=tuple(each.to_json() for each in found),
        groups=tuple(each.to_json() for each in groups),
        weak_group=weak_group(groups),
        own_cell=fitted is not None,
    )
    report(1.0, "done")
    return ModuleFit(
        model=ModuleNetwork(network, best.model, record),
        train=best.train,
        validation=best.validation,
        train_runs=_each(best, train, [(value, None) for value in soc]),
        validation_runs=_each(best, validate, judged),
        expected_rmse_mV=max(best.held_out_rmse_mV, _cells_mV(fitted, layout[0])),
        n_samples=sum(len(run.voltage_V) for run in train),
        seconds=time.perf_counter() - started,
        initial_soc=list(soc),
    )


def _given_cell(request: ModuleFitRequest) -> LocalModelNetwork:
    """Network from tests of cells, of the module's capacity, without what was put right in those tests' own logs."""
    assert request.cell is not None  # the caller asked for it
    record = request.cell.record
    effects = tuple(each for each in record.effects if not each["correction"])
    cell = replace(request.cell.cell, capacity_Ah=request.capacity_Ah / request.parallel)
    return replace(request.cell, cell=cell, record=replace(record, effects=effects))


def _mean_cell(request: ModuleFitRequest, layout: tuple[int, int], soc: list[float], report: Progress) -> FitResult:
    asked = FitRequest(
        train=[log.mean_cell(*layout) for log in request.train],
        capacity_Ah=request.capacity_Ah / request.parallel,
        structure=request.structure,
        initial_soc=soc,
        initial_soc_std=request.initial_soc_std,
        coulombic_efficiency=request.coulombic_efficiency,
        progress=report,
        without=request.without,
        code_version=request.code_version,
        # Beside the mean cell stand voltages of cells that nobody puts in step.
        in_step=True,
    )
    return fit(asked)


def _beside_cells(
    network: LocalModelNetwork, logs: Sequence[ModuleLog], layout: tuple[int, int], soc: list[float]
) -> list[ModuleRun]:
    """Measured voltage of the module beside the mean cell's free run, on the model's grid."""
    means = [log.mean_cell(*layout) for log in logs]
    placed = place_runs(network, means, soc)
    grid = [to_grid(log.run, network.dt_s) for log in logs]
    return [
        ModuleRun(run.voltage_V, run.current_A, each.simulated_V, run.name)
        for run, each in zip(grid, placed, strict=True)
    ]


def _each(best: Candidate, runs: list[ModuleRun], starts: Sequence[tuple[float, float | None]]) -> list[Json]:
    rows: list[dict[str, Any]] = []
    for run, (value, std) in zip(runs, starts, strict=True):
        rows.append({"run": run.name, **figures(best.model, [run]), "initial_soc": {"value": value, "std": std}})
    return rows


def _cells_mV(fitted: FitResult | None, in_series: int) -> float:
    return 0.0 if fitted is None else in_series * fitted.expected_rmse_mV
