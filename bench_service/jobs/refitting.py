"""A model's parameters fitted again to new runs, with all that a MODEL.json carries; the models are imported inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.jobs.modelling import plain
from bench_service.jobs.progress import Reporter
from bench_service.jobs.results import Document, VersionResult
from bench_service.jobs.series import RunInput, noise_floor_mV, read_series
from models.data.seal import sealed

if TYPE_CHECKING:
    from models.comparison.placed_runs import ErrorsApart
    from models.data.timeseries import TimeSeries
    from models.network.local_model_network import LocalModelNetwork


def refitted(
    parent: LocalModelNetwork, runs: list[TimeSeries], initial_soc: list[float], old_weight: float | None
) -> LocalModelNetwork:
    """Refit a network with the sums that it holds of its old runs, read out its tables, and tune its observer.

    Parameters
    ----------
    parent : LocalModelNetwork
    runs, initial_soc : list
        New runs and where they start.
    old_weight : float or None
        How much an old sample counts beside a new one; None: chosen on parts of the new runs.
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.identification.stored_sums import sums_of
    from models.observer.tuning.tuning import with_tuned_observer
    from models.pipeline.refitting import refit
    from models.readouts.tables import read_out

    made = refit(
        parent,
        runs,
        initial_soc=initial_soc,
        old=sums_of(parent),
        old_weight=old_weight,
        code_version=version("bench-service"),
    )
    network = with_tuned_observer(made.network, runs, initial_soc)
    return replace(network, record=replace(network.record, tables=dict(read_out(network))))


def version_errors(before: ErrorsApart, after: ErrorsApart) -> dict[str, Any]:
    """Give the errors of two versions as `jobs.results.VersionMetrics` has them."""
    return {
        "error_before_mV": before.overall_mV,
        "error_after_mV": after.overall_mV,
        "inside": {"before_mV": before.inside_mV, "after_mV": after.inside_mV},
        "outside": {"before_mV": before.outside_mV, "after_mV": after.outside_mV},
    }


def refit_to(
    report: Reporter,
    data_dir: Path,
    document: Document,
    train: Sequence[RunInput],
    validate: Sequence[RunInput],
) -> VersionResult:
    """Refit a model to stored runs.

    Returns
    -------
    dict
        As `jobs.diagnosing.add_effect_to`, without an effect and parameters.
    """
    # Lazy: numba and scipy take 1.1 s.
    from models.comparison.placed_runs import errors_apart
    from models.network.local_model_network import LocalModelNetwork

    report(0.02, "reading samples")
    learned, judged = (read_series(data_dir, runs) for runs in (train, validate))
    learned_soc, judged_soc = ([run.initial_soc for run in runs] for runs in (train, validate))
    parent = LocalModelNetwork.from_json(document)
    report(0.1, "refitting to the training runs")
    network = refitted(parent, learned, learned_soc, None)
    errors = (errors_apart(each, judged, judged_soc, parent) for each in (parent, network))
    metrics = {
        "effect": None,
        **version_errors(*errors),
        "parameters": {},
        "remark": "structure and partition stay; the parameters were fitted again",
        "usability": network.record.usability,
        "noise_floor_mV": noise_floor_mV(judged, parent.structure.dt_s),
    }
    structure, capacity_Ah = network.structure.name, network.cell.capacity_Ah
    return plain(
        {
            "document": sealed(plain(network.to_json())),
            "structure": structure,
            "capacity_Ah": capacity_Ah,
            "metrics": metrics,
        }
    )
