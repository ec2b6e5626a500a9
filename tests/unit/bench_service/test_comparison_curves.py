"""Curves of a comparison: same rows for all, missing values missing, extremes kept."""

import json

import numpy as np

from bench_service.jobs.modelling import _curves, plain
from models.comparison.simulated_runs import RunComparison
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries


def compared(voltage_V: np.ndarray, simulated_V: np.ndarray, start_s: float = 0.0) -> tuple[TimeSeries, RunComparison]:
    n = len(voltage_V)
    flat = np.zeros(n)
    series = TimeSeries(start_s + np.arange(n), flat, voltage_V, flat + 25.0, name="r")
    run = to_grid(series, 1.0)
    return series, RunComparison(run, simulated_V, flat + 0.5, np.ones(n, bool))


def test_the_residual_is_measured_minus_model_and_missing_where_either_is() -> None:
    measured, model = np.array([3.7, np.nan, np.nan, 3.6, 3.5]), np.array([3.6, 3.6, 3.6, np.nan, 3.75])
    curves = plain(_curves(*compared(measured, model, start_s=10.0), 100))
    assert curves["time_s"] == [10.0, 11.0, 12.0, 13.0, 14.0] and curves["run_id"] == "r"
    assert curves["measured_V"] == [3.7, None, None, 3.6, 3.5]
    assert curves["model_V"] == [3.6, 3.6, 3.6, None, 3.75]
    assert [value and round(value, 6) for value in curves["residual_mV"]] == [100.0, None, None, None, -250.0]
    assert json.loads(json.dumps(curves, allow_nan=False)) == curves


def test_a_spike_of_a_single_sample_survives_thinning() -> None:
    measured, model = np.full(10_000, 3.7), np.full(10_000, 3.7)
    measured[1234] += 0.3
    model[7654] -= 0.2
    curves = plain(_curves(*compared(measured, model), 100))
    assert len(curves["time_s"]) <= 100
    at = curves["time_s"].index(1234.0)
    assert round(curves["residual_mV"][at]) == 300
    assert round(curves["residual_mV"][curves["time_s"].index(7654.0)]) == 200
