"""Model against measurement: how large the error is, and where it lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, TypedDict

import numpy as np

from models.comparison.placed_runs import fit_starts, place_runs
from models.comparison.reach import BandFigures, Gaps, band_figures, bands, expected_rmse_mV, gaps, inside_by
from models.comparison.samples import error_samples
from models.comparison.shares import ErrorShare, error_shares
from models.comparison.simulated_runs import RunComparison
from models.comparison.start import Start
from models.comparison.where import Region, regions
from models.comparison.whiteness import Whiteness, whiteness
from models.data.errors import ModelError
from models.data.metrics import Metrics, RunMetrics, metrics, noise_floor_V
from models.data.timeseries import FloatArray, TimeSeries
from models.effects.input_correction import corrections_of
from models.module.network import ModuleNetwork
from models.network.cell_model import CellModel
from models.network.local_model_network import LocalModelNetwork
from models.thermal.cell_temperature import TemperatureComparison, compare_temperature

_MIN_COMPARED = 10


class ComparedRun(RunMetrics):
    """Figures of one run from its stated start, and where all of its voltage says that it begins.

    `initial_soc`: its value, with a standard deviation; the stated value, as far as somebody's word goes, where nothing
    else is clearly better. `started`: "as_stated", or "by_first_minute" where it plainly did not begin at rest.
    """

    started: str
    initial_soc: dict[str, float | None]


class Comparison(TypedDict):
    """The `compare` object of the public contract; see `compare`."""

    overall: Metrics
    expected_rmse_mV: float | None
    overall_fitted_start: Metrics
    inside_training: Metrics | None
    outside: Metrics | None
    runs: list[ComparedRun]
    noise_floor_mV: float | None
    whiteness: Whiteness | None
    where: list[ErrorShare]
    regions: list[Region]
    outside_training: float
    outside_by: dict[str, float]
    gaps: list[Gaps]
    corrections: list[dict[str, Any]]
    band: BandFigures | None
    temperature: TemperatureComparison | None
    usability: dict[str, Any] | None


def compare(
    network: CellModel,
    runs: list[TimeSeries],
    initial_soc: list[float],
    soc_std: Sequence[float | None] | None = None,
) -> Comparison:
    """Free-run error overall, of each run, and where it lies.

    No figure but those of the fitted start uses the voltage after the first 60 s.

    Parameters
    ----------
    network : the model
    runs : measurements that the fit may or may not have seen
    initial_soc : fraction 0..1 of each run
    soc_std : its standard deviation, for the fitted start; None: somebody's word

    Returns
    -------
    The `compare` object of the public contract; ``expected_rmse_mV``: what the model itself says of the error on runs
    that go where these go, by their currents and temperatures alone (of a single cell); ``overall_fitted_start`` from
    starts that all of the voltage says; ``inside_training`` and ``outside`` are the overall figures apart, None
    where no sample lies there; ``where`` and ``regions`` count the samples inside (all, where none lies inside).
    """
    if not runs:
        raise ModelError("nothing to compare: no run was given")
    compared = place_runs(network, runs, initial_soc)
    grid = [c.run for c in compared]
    measured = np.concatenate([c.run.voltage_V for c in compared])
    simulated = np.concatenate([c.simulated_V for c in compared])
    _check_comparable(measured, simulated)
    floors = [noise_floor_V(c.run.voltage_V, c.run.current_A) for c in compared]
    known = [f for f in floors if not np.isnan(f)]
    inside = np.concatenate([c.inside for c in compared])
    samples, _ = error_samples(network, compared)
    fitted = fit_starts(network, compared, soc_std)
    found = bands(network, grid, [c.start for c in compared])
    return {
        "overall": metrics(measured, simulated),
        "expected_rmse_mV": expected_rmse_mV(found, grid) if isinstance(network, LocalModelNetwork) else None,
        "overall_fitted_start": metrics(measured, np.concatenate([c.simulated_V for c in fitted])),
        "inside_training": _figures(measured, simulated, inside),
        "outside": _figures(measured, simulated, ~inside),
        "runs": [_run_figures(c, each.start) for c, each in zip(compared, fitted, strict=True)],
        "noise_floor_mV": 1e3 * float(np.median(known)) if known else None,
        "whiteness": whiteness(compared),
        "where": error_shares(samples),
        "regions": regions(samples),
        "outside_training": float(1.0 - inside.mean()),
        "outside_by": _outside_by(network, compared),
        "gaps": [gaps(run) for run in grid],
        "corrections": [asdict(each) for each in corrections_of(network.record)],
        "band": band_figures(found, grid, [c.inside for c in compared]),
        "temperature": compare_temperature(network, grid, initial_soc)
        if isinstance(network, LocalModelNetwork)
        else None,
        "usability": network.record.usability if isinstance(network, LocalModelNetwork | ModuleNetwork) else None,
    }


def _run_figures(compared: RunComparison, fitted: Start) -> ComparedRun:
    return {
        "run": compared.run.name,
        **metrics(compared.run.voltage_V, compared.simulated_V),
        "started": "as_stated" if compared.start.history is None else "by_first_minute",
        "initial_soc": fitted.to_json(),
    }


def _figures(measured_V: FloatArray, simulated_V: FloatArray, chosen: np.ndarray) -> Metrics | None:
    chosen = chosen & ~np.isnan(measured_V)
    return metrics(measured_V[chosen], simulated_V[chosen]) if chosen.any() else None


def _outside_by(network: CellModel, compared: list[RunComparison]) -> dict[str, float]:
    """Share of the samples outside the trained range of each dimension."""
    parts = [inside_by(network, c.run, c.soc, c.start) for c in compared]
    return {name: float(1.0 - np.concatenate([part[name] for part in parts]).mean()) for name in parts[0]}


def _check_comparable(measured_V: FloatArray, simulated_V: FloatArray) -> None:
    """Refuse figures of almost nothing: a model that cannot be simulated must not look perfect."""
    known = ~np.isnan(measured_V)
    lost = int((known & ~np.isfinite(simulated_V)).sum())
    if lost:
        raise ModelError(
            f"the model gives no voltage at {lost} of {int(known.sum())} samples: temperature is missing there, or the "
            "model is not for this cell"
        )
    if int(known.sum()) < _MIN_COMPARED:
        raise ModelError(
            f"{int(known.sum())} samples have a voltage on the model's grid; at least {_MIN_COMPARED} are needed"
        )
