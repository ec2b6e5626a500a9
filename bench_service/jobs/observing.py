"""What worker processes do to observe stored runs; arguments and results are plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bench_service.jobs.counting import counted_soc
from bench_service.jobs.modelling import plain
from bench_service.jobs.progress import Reporter
from bench_service.jobs.results import Document
from bench_service.jobs.series import RunInput, read_series
from bench_service.store.records import Json

if TYPE_CHECKING:
    from models.data.timeseries import TimeSeries


def observe_runs(
    report: Reporter,
    data_dir: Path,
    document: Document,
    runs: Sequence[RunInput],
    initial_soc: float | None,
    gain: str | None,
) -> Json:
    """Replay stored runs through a model's observer; gives the ``observe`` object of the public contract.

    Parameters
    ----------
    document : dict
        MODEL.json.
    runs : sequence of RunInput
        Each with the state of charge that it is said to begin at; the reference is counted from there.
    initial_soc : float or None
        Where the observer begins; None: where the run does.
    gain : str or None
        See `models.observer.observation.observer_of`; of a module that of its mean cell.
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.module.network import ModuleNetwork, model_from_json
    from models.observer.module.tuning import module_observer
    from models.observer.observation import answer_of, observe, observer_of

    report(0.0, "reading samples")
    model, observed = model_from_json(document), []
    observer = module_observer(model, gain) if isinstance(model, ModuleNetwork) else observer_of(model, gain)
    series = read_series(data_dir, runs)
    for done, (each, run) in enumerate(zip(series, runs, strict=True)):
        report((done + 0.1) / len(series), f"observing run {each.name}")
        start = run.initial_soc if initial_soc is None else initial_soc
        observed.append(observe(observer, _counted(each, run, model.cell.capacity_Ah), start, None))
    return plain(answer_of(observer, observed))


def _counted(series: TimeSeries, run: RunInput, capacity_Ah: float) -> TimeSeries:
    """Return a run with the charge counted from its start as the reference."""
    time_s, current_A = np.asarray(series.time_s, np.float64), np.asarray(series.current_A, np.float64)
    return replace(series, soc_ref=counted_soc(time_s, current_A, run.initial_soc, capacity_Ah))
