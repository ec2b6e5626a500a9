"""What worker processes do with models; arguments and results are plain data, the samples they read themselves.

The models are imported inside the functions: the service names these functions without ever calling them, and would
pay a second of its start for libraries that only workers use.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import closing
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench_service.errors import BadRequestError
from bench_service.jobs.counting import counted_soc
from bench_service.jobs.joining import joined
from bench_service.jobs.progress import Reporter
from bench_service.jobs.results import ComparisonResult, Curves, Document, FitResult, SocFigures
from bench_service.jobs.series import RunInput, read_logs, read_series
from bench_service.store.decimation import kept_rows
from bench_service.store.integrity import Expected, read_whole
from bench_service.store.records import Json
from bench_service.store.samples import SampleReader
from bench_service.streams import OBSERVER
from models.data.seal import sealed

if TYPE_CHECKING:
    from models.comparison.simulated_runs import RunComparison
    from models.data.timeseries import TimeSeries


def fit(
    report: Reporter,
    data_dir: Path,
    train: Sequence[RunInput],
    validate: Sequence[RunInput],
    capacity_Ah: float,
    structure: str,
    pauses_s: Sequence[float] = (),
    initial_soc_std: float = 0.0,
    coulombic_efficiency: float = 1.0,
    without: Sequence[str] = (),
) -> FitResult:
    """Identify a network from stored runs; with `pauses_s` between them the training runs are one log, see `joined`.

    Parameters
    ----------
    initial_soc_std, coulombic_efficiency, without : as in `models.pipeline.request.fit_request.FitRequest`

    Returns
    -------
    dict
        ``document`` (MODEL.json) and ``metrics`` (the ``fit`` object of the public contract, without its paths).
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.observer.tuning.tuning import with_tuned_observer
    from models.pipeline.fit import fit_network

    report(0.0, "reading samples")
    train_runs = read_series(data_dir, train)
    if pauses_s:
        train_runs, train = [joined(train_runs, pauses_s)], train[:1]
    result = fit_network(
        train_runs,
        capacity_Ah=capacity_Ah,
        structure=structure,
        without=tuple(without),
        validate=read_series(data_dir, validate) or None,
        initial_soc=[run.initial_soc for run in train],
        validate_soc=[run.initial_soc for run in validate] or None,
        initial_soc_std=initial_soc_std,
        coulombic_efficiency=coulombic_efficiency,
        progress=report,
        code_version=version("bench-service"),
    )
    metrics = {
        "structure": result.network.structure.name,
        "n_samples": result.n_samples,
        "n_local_models": result.network.n_models,
        "seconds": result.seconds,
        "train": result.train,
        "validation": result.validation,
        "expected_rmse_mV": result.expected_rmse_mV,
        "compared": result.compared,
        "terms": result.terms,
        "usability": result.network.record.usability,
        "runs": {"train": result.train_runs, "validation": result.validation_runs},
    }
    network = with_tuned_observer(result.network, train_runs, result.initial_soc)
    return plain({"document": sealed(plain(network.to_json())), "metrics": metrics})


def compare_runs(
    report: Reporter,
    data_dir: Path,
    document: Document,
    runs: Sequence[RunInput],
    baselines: Sequence[str] = (),
    train: Sequence[RunInput] = (),
) -> ComparisonResult:
    """Compare a model with stored runs; gives the ``compare`` object of the public contract.

    Parameters
    ----------
    baselines, train : fitted to these runs and judged beside the model, see `models.baselines.beside`
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.comparison.figures import compare
    from models.comparison.module_models import compare_module
    from models.module.network import ModuleNetwork, model_from_json

    model, logs = model_from_json(document), read_logs(data_dir, runs)
    series, soc = [log.run for log in logs], [run.initial_soc for run in runs]
    found: dict[str, Any] = dict(compare(model, series, soc))
    if baselines:
        from models.baselines.beside import beside_baselines  # lazy: only those who ask for circuits wait for them

        learned = read_series(data_dir, train), [run.initial_soc for run in train]
        found["baselines"] = beside_baselines(model, baselines, learned, (series, soc))
    if isinstance(model, ModuleNetwork):
        found["module"] = compare_module(model, logs, soc)
    return plain(found)


def read_tables(report: Reporter, data_dir: Path, document: Document) -> Json:
    """Read tables out of a model whose document carries none, such as one made before they were kept."""
    # Lazy: numba and scipy take 820 ms.
    from models.network.local_model_network import LocalModelNetwork
    from models.readouts.tables import read_out

    return plain(read_out(LocalModelNetwork.from_json(document)))


def compare_series(
    report: Reporter, data_dir: Path, document: Document, runs: Sequence[RunInput], most_rows: int
) -> dict[str, list[Curves]]:
    """Free run of a model beside stored runs, on the model's grid: ``{"curves": [...]}``.

    Parameters
    ----------
    document : dict
        MODEL.json.
    most_rows : int
        Largest number of rows of all runs together; with more than that they are thinned, extremes kept.
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.comparison.placed_runs import place_runs
    from models.module.network import model_from_json

    series = read_series(data_dir, runs)
    compared = place_runs(model_from_json(document), series, [run.initial_soc for run in runs])
    most = most_rows // max(len(series), 1)
    return {"curves": [curves_of(each, beside, most) for each, beside in zip(series, compared, strict=True)]}


def compare_table(
    report: Reporter, data_dir: Path, document: Document, runs: Sequence[RunInput]
) -> dict[str, list[Any]]:
    """Every sample of a comparison, see `models.comparison.series.series_columns`; null where a value is missing."""
    # Lazy: numba and scipy take 1.0 s.
    from models.comparison.series import series_columns
    from models.module.network import model_from_json

    series = read_series(data_dir, runs)
    return plain(series_columns(model_from_json(document), series, [run.initial_soc for run in runs]))


def observer_figures(report: Reporter, data_dir: Path, run: RunInput, capacity_Ah: float) -> SocFigures:
    """Judge the live observer of a stored run by the charge counted from a start that is known.

    Returns
    -------
    dict
        See `models.observer.tuning.accuracy.soc_figures`.

    Raises
    ------
    BadRequestError
        No observer has run in it.
    """
    # Lazy: numba and scipy take 820 ms.
    from models.observer.tuning.accuracy import soc_figures

    with closing(SampleReader(data_dir)) as reader:
        expected = Expected(run.run_id, run.n_samples, run.sha256)
        samples, estimate = read_whole(reader, expected).columns, reader.read(run.run_id, OBSERVER).columns
    if not samples or not estimate:
        raise BadRequestError("no observer ran in the run", ("run", run.run_id))
    reference = counted_soc(samples["time_s"], samples["current_A"], run.initial_soc, capacity_Ah)
    at = np.searchsorted(samples["time_s"], estimate["time_s"])
    reference = reference[np.minimum(at, len(reference) - 1)]
    return plain(soc_figures(estimate["time_s"], estimate["soc"], estimate["soc_std"], reference))


def plain(value: Any) -> Any:
    """Turn numpy scalars, arrays and tuples into what JSON knows; NaN and infinity become null."""
    if isinstance(value, dict):
        return {str(name): plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def curves_of(series: TimeSeries, beside: RunComparison, most_rows: int) -> Curves:
    """Return the curves of one run."""
    columns = {
        "measured_V": beside.run.voltage_V,
        "model_V": beside.simulated_V,
        "residual_mV": 1e3 * beside.residual_V,
    }
    time_s = series.time_s[0] + beside.run.time_s
    if len(time_s) > most_rows:
        rows = kept_rows(columns, len(time_s), most_rows, tuple(columns))
        time_s, columns = time_s[rows], {name: values[rows] for name, values in columns.items()}
    return Curves(series.name, time_s, columns)
