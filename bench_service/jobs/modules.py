"""What worker processes do with modules of cells; arguments and results are plain data."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TypedDict

from bench_service.jobs.modelling import plain
from bench_service.jobs.progress import Reporter
from bench_service.jobs.results import Document, FitResult
from bench_service.jobs.series import RunInput, read_logs
from models.data.seal import sealed


class ModuleWish(TypedDict):
    """Layout of a module (`in_series` None: as many as have a voltage), and the model of one cell, where there is one.

    `structure`, `without`, `initial_soc_std`, `coulombic_efficiency` are of the mean cell's network, see
    `models.pipeline.request.fit_request.FitRequest`.
    """

    in_series: int | None
    parallel: int
    cell: Document | None
    structure: str
    without: Sequence[str]
    initial_soc_std: float
    coulombic_efficiency: float


def fit_module_runs(
    report: Reporter,
    data_dir: Path,
    train: Sequence[RunInput],
    validate: Sequence[RunInput],
    capacity_Ah: float,
    wish: ModuleWish,
) -> FitResult:
    """Identify the model of a module from stored runs; see `jobs.modelling.fit`."""
    # Lazy: numba and scipy take 1.0 s.
    from models.network.local_model_network import LocalModelNetwork
    from models.observer.module.tuning import with_tuned_module
    from models.pipeline.module.fit import ModuleFitRequest, fit_module

    report(0.0, "reading samples")
    logs = read_logs(data_dir, train)
    found = fit_module(
        ModuleFitRequest(
            train=logs,
            capacity_Ah=capacity_Ah,
            in_series=wish["in_series"],
            parallel=wish["parallel"],
            validate=read_logs(data_dir, validate),
            cell=None if wish["cell"] is None else LocalModelNetwork.from_json(wish["cell"]),
            initial_soc=[run.initial_soc for run in train],
            validate_soc=[run.initial_soc for run in validate],
            structure=wish["structure"],
            without=tuple(wish["without"]),
            initial_soc_std=wish["initial_soc_std"],
            coulombic_efficiency=wish["coulombic_efficiency"],
            progress=report,
            code_version=version("bench-service"),
        )
    )
    model = with_tuned_module(found.model, [log.run for log in logs], found.initial_soc)
    return plain(
        {"document": sealed(plain(model.to_json())), "metrics": found.to_json() | {"compared": [], "terms": []}}
    )
