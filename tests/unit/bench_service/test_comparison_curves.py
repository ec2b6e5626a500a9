"""Curves of a comparison: same rows for all, missing values missing, extremes kept."""

import asyncio
import json
from typing import Any

import numpy as np
import pytest

from bench_service.campaign.comparison_curves import ComparisonCurves, CurvePart, as_json
from bench_service.jobs.modelling import curves_of
from bench_service.jobs.results import Curves
from models.comparison.simulated_runs import RunComparison
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries


def compared(voltage_V: np.ndarray, simulated_V: np.ndarray, start_s: float = 0.0) -> tuple[TimeSeries, RunComparison]:
    n = len(voltage_V)
    flat = np.zeros(n)
    series = TimeSeries(start_s + np.arange(n), flat, voltage_V, flat + 25.0, name="r")
    run = to_grid(series, 1.0)
    return series, RunComparison(run, simulated_V, flat + 0.5, np.ones(n, bool))


def drawn(curves: Curves, part: CurvePart | None = None) -> dict[str, Any]:
    (run,) = json.loads(as_json([curves], part or CurvePart()))["runs"]
    return run


def test_the_residual_is_measured_minus_model_and_missing_where_either_is() -> None:
    measured, model = np.array([3.7, np.nan, np.nan, 3.6, 3.5]), np.array([3.6, 3.6, 3.6, np.nan, 3.75])
    curves = drawn(curves_of(*compared(measured, model, start_s=10.0), 100))
    assert curves["time_s"] == [10.0, 11.0, 12.0, 13.0, 14.0] and curves["run_id"] == "r"
    assert curves["measured_V"] == [3.7, None, None, 3.6, 3.5]
    assert curves["model_V"] == [3.6, 3.6, 3.6, None, 3.75]
    assert [value and round(value, 6) for value in curves["residual_mV"]] == [100.0, None, None, None, -250.0]


def test_a_spike_of_a_single_sample_survives_thinning() -> None:
    measured, model = np.full(10_000, 3.7), np.full(10_000, 3.7)
    measured[1234] += 0.3
    model[7654] -= 0.2
    curves = drawn(curves_of(*compared(measured, model), 20_000), CurvePart(points=100))
    assert len(curves["time_s"]) <= 100
    at = curves["time_s"].index(1234.0)
    assert round(curves["residual_mV"][at]) == 300
    assert round(curves["residual_mV"][curves["time_s"].index(7654.0)]) == 200


def test_a_part_is_as_fine_as_the_data() -> None:
    flat = np.full(10_000, 3.7)
    curves = curves_of(*compared(flat, flat, start_s=5.0), 20_000)
    part = drawn(curves, CurvePart(1000.0, 1050.0, 100))
    assert part["time_s"] == list(np.arange(1000.0, 1051.0)) and part["model_V"] == [3.7] * 51
    assert drawn(curves, CurvePart(20_000.0, None))["time_s"] == []
    assert len(drawn(curves_of(*compared(flat, flat), 500))["time_s"]) <= 500, "a worker sends no more than is kept"


def test_curves_are_simulated_once_and_what_failed_is_tried_again() -> None:
    asked: list[str] = []

    async def simulate(comparison_id: str) -> list[Curves]:
        asked.append(comparison_id)
        if len(asked) == 1:
            raise RuntimeError("no worker")
        return [Curves("r", np.arange(4.0), {"model_V": np.arange(4.0)})]

    async def look() -> list[bytes]:
        kept = ComparisonCurves(simulate)
        with pytest.raises(RuntimeError):
            await kept.part("c", CurvePart())
        return list(await asyncio.gather(kept.part("c", CurvePart()), kept.part("c", CurvePart(1.0, 2.0))))

    whole, part = asyncio.run(look())
    assert asked == ["c", "c"]
    assert json.loads(whole)["runs"][0]["model_V"] == [0.0, 1.0, 2.0, 3.0]
    assert json.loads(part)["runs"][0]["model_V"] == [1.0, 2.0]
