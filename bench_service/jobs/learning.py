"""What worker processes do to learn from stored runs, one after the other; arguments and results are plain data."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypedDict

from bench_service.jobs.modelling import plain
from bench_service.jobs.progress import Reporter
from bench_service.jobs.results import Document
from bench_service.jobs.series import RunInput, noise_floor_mV, read_series
from models.data.seal import sealed


class LearnedVersion(TypedDict):
    """What came of one run: `document` and `structure` are None where the model stays as it was."""

    run_id: str
    document: Document | None
    structure: str
    number: int
    capacity_Ah: float
    metrics: dict[str, Any]


class LearningResult(TypedDict):
    """One entry for each run, in their order."""

    versions: list[LearnedVersion]


def learn_runs(
    report: Reporter, data_dir: Path, document: Document, runs: Sequence[RunInput], validate: Sequence[RunInput]
) -> LearningResult:
    """Learn from stored runs; see `models.pipeline.learning.learn.learn_from_runs`.

    Returns
    -------
    dict
        Of each run the next version, and its figures: ``error_before_mV`` of the version before it, on the runs of
        `validate` or, without any, on the run itself, which that version had not seen; ``error_after_mV`` only on
        runs of `validate`: no other has not been seen then.
    """
    # Lazy: numba and scipy take 1.1 s.
    from models.comparison.placed_runs import free_run_metrics
    from models.network.lineage import version_of
    from models.network.local_model_network import LocalModelNetwork
    from models.pipeline.learning.learn import learn_from_run

    report(0.0, "reading samples")
    series, judged = read_series(data_dir, runs), read_series(data_dir, validate) if validate else []
    judged_soc = [run.initial_soc for run in validate]
    network, versions = LocalModelNetwork.from_json(document), list[LearnedVersion]()
    for number, (each, run) in enumerate(zip(series, runs, strict=True)):
        report((number + 0.1) / len(runs), f"learning from run {each.name}")
        found = learn_from_run(network, each, run.initial_soc, version("bench-service"))
        errors: dict[str, Any] = {"error_before_mV": found.before["rmse_mV"]}
        if judged:
            before, after = (free_run_metrics(model, judged, judged_soc) for model in (network, found.network))
            errors = {"error_before_mV": before["rmse_mV"], "error_after_mV": after["rmse_mV"]}
        told = found.to_json()
        made = version_of(found.network)
        metrics = {
            "effect": None,
            "learned_from": run.run_id,
            **errors,
            "run_before_mV": told["error_before_mV"],
            "run_after_mV": told["error_after_mV"],
            "parameters": {"capacity_Ah": told["capacity_Ah"] | {"unit": "Ah"}},
            "remark": found.reason,
            "usability": found.network.record.usability,
            "noise_floor_mV": noise_floor_mV(judged or [each], network.dt_s),
        }
        versions.append(
            {
                "run_id": run.run_id,
                "document": sealed(plain(found.network.to_json())) if found.learned else None,
                "structure": found.network.structure.name,
                "number": made.number if made else 1,
                "capacity_Ah": found.network.cell.capacity_Ah,
                "metrics": metrics,
            }
        )
        network = found.network
    return plain({"versions": versions})
