"""What worker processes do with models; arguments and results are plain data, the samples they read themselves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.jobs.progress import Reporter
from bench_service.jobs.series import read_series
from models.comparison import compare
from models.identification import fit_network
from models.local_model_network import LocalModelNetwork


@dataclass(frozen=True, slots=True)
class RunInput:
    """A stored run and the state of charge, 0..1, at its start."""

    run_id: str
    initial_soc: float


def fit(
    report: Reporter,
    data_dir: Path,
    train: Sequence[RunInput],
    validate: Sequence[RunInput],
    capacity_Ah: float,
    structure: str,
) -> dict[str, Any]:
    """Identify a network from stored runs.

    Returns
    -------
    dict
        ``document`` (MODEL.json) and ``metrics`` (the ``fit`` object of the public contract, without its paths).
    """
    report(0.0, "reading samples")
    result = fit_network(
        read_series(data_dir, [run.run_id for run in train]),
        capacity_Ah=capacity_Ah,
        structure=structure,
        validate=read_series(data_dir, [run.run_id for run in validate]) or None,
        initial_soc=[run.initial_soc for run in train],
        validate_soc=[run.initial_soc for run in validate] or None,
        progress=report,
    )
    metrics = {
        "structure": structure,
        "n_samples": result.n_samples,
        "n_local_models": result.network.n_models,
        "seconds": result.seconds,
        "train": result.train,
        "validation": result.validation,
    }
    return plain({"document": result.network.to_json(), "metrics": metrics})


def compare_runs(
    report: Reporter, data_dir: Path, document: dict[str, Any], runs: Sequence[RunInput]
) -> dict[str, Any]:
    """Compare a model with stored runs; gives the ``compare`` object of the public contract."""
    series = read_series(data_dir, [run.run_id for run in runs])
    return plain(compare(LocalModelNetwork.from_json(document), series, [run.initial_soc for run in runs]))


def plain(value: Any) -> Any:
    """Turn numpy scalars and tuples into what JSON knows; NaN and infinity become null."""
    if isinstance(value, dict):
        return {str(name): plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value
