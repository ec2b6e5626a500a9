"""What worker processes do to follow a cell over its life; arguments and results are plain data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench_service.jobs.modelling import plain
from bench_service.jobs.progress import Reporter
from bench_service.jobs.results import Document
from bench_service.jobs.series import RunInput, read_series
from bench_service.store.records import Json


def follow_runs(
    report: Reporter,
    data_dir: Path,
    document: Document,
    runs: Sequence[RunInput],
    train: Sequence[RunInput],
    along: Json,
    initial_soc_std: float | None = None,
) -> Json:
    """Follow a cell through stored runs; gives the ``trend`` object of the public contract.

    Parameters
    ----------
    along : dict
        ``at`` (places of the runs or null), ``unit`` and ``end``.
    """
    # Lazy: numba and scipy take 890 ms.
    from bench_service.jobs.beside import spread
    from models.diagnosis.trend.life import Places
    from models.diagnosis.trend.trend import trend
    from models.network.local_model_network import LocalModelNetwork

    report(0.0, "reading samples")
    series, learned = read_series(data_dir, runs), read_series(data_dir, train) if train else []
    found = trend(
        LocalModelNetwork.from_json(document),
        series,
        [run.initial_soc for run in runs],
        train=learned or None,
        train_soc=[run.initial_soc for run in train] or None,
        soc_std=None if initial_soc_std is None else [initial_soc_std] * len(runs),
        places=Places(along["at"], along["unit"], along["end"]),
        progress=lambda share, name: report(0.05 + 0.95 * share, f"following the cell: run {name}"),
        spread=spread,
    )
    return plain(found.to_json())
