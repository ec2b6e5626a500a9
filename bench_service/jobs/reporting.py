"""Reports whose curves are simulated: made by workers, which read the samples themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench_service.jobs.progress import Reporter
from bench_service.jobs.results import Document
from bench_service.jobs.series import RunInput, read_series
from bench_service.reports.document import Heading, render


def report_comparison(
    report: Reporter,
    data_dir: Path,
    document: Document,
    runs: Sequence[RunInput],
    result: Mapping[str, Any],
    heading: Heading,
    called: Mapping[str, str],
) -> dict[str, bytes]:
    """Write the report of a comparison, ``{"page": ...}``; `called`: what people call the runs, by their ids."""
    # Lazy: numba and scipy take 1.0 s.
    from bench_service.reports.comparison import comparison_report
    from models.module.network import model_from_json

    soc = [run.initial_soc for run in runs]
    made = comparison_report(heading, model_from_json(document), read_series(data_dir, runs), soc, result, called)
    return {"page": render(made)}


def report_diagnosis(
    report: Reporter,
    data_dir: Path,
    document: Document,
    runs: Sequence[RunInput],
    result: Mapping[str, Any],
    heading: Heading,
    called: Mapping[str, str],
) -> dict[str, bytes]:
    """Write the report of a diagnosis; see `report_comparison`."""
    # Lazy: numba and scipy take 1.0 s.
    from bench_service.reports.diagnosis import diagnosis_report
    from models.network.local_model_network import LocalModelNetwork

    network, soc = LocalModelNetwork.from_json(document), [run.initial_soc for run in runs]
    return {"page": render(diagnosis_report(heading, network, read_series(data_dir, runs), soc, result, called))}
