"""Comparisons from where runs begin: nothing of the judged voltage but the first minute, a fitted start apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.comparison.figures import compare
from models.comparison.placed_runs import place_runs
from models.comparison.reach import inside_by
from models.comparison.series import series_columns
from models.comparison.start import Start
from models.data.history import StartHistory
from models.data.timeseries import TimeSeries
from models.network.model_record import ModelRecord
from tests.unit.models.comparison.test_start_fit import BEFORE, cell, cut
from tests.unit.models.hand_network import grid_run

MODEL = cell(0)


def log(before_A: np.ndarray, seed: int, name: str = "a") -> tuple[TimeSeries, float]:
    run, soc = cut(MODEL, before_A, seed)
    return TimeSeries(5.0 + run.time_s, run.current_A, run.voltage_V, run.temperature_degC, name=name), soc


def test_overall_never_sees_the_voltage_after_the_first_minute() -> None:
    run, soc = log(BEFORE["in a relaxation"], 3)
    late = run.voltage_V + np.where(run.time_s > run.time_s[0] + 60.0, 0.05, 0.0)
    (as_it_is,) = place_runs(MODEL, [run], [soc])
    (shifted,) = place_runs(MODEL, [replace(run, voltage_V=late)], [soc])
    assert shifted.start == as_it_is.start
    assert shifted.simulated_V == pytest.approx(as_it_is.simulated_V, abs=0.0)


def test_an_error_from_a_fitted_start_stands_apart() -> None:
    logs = [log(BEFORE["on the upper branch"], 3, "a"), log(np.zeros(1), 4, "b")]
    stated = [logs[0][1] + 0.05, logs[1][1]]
    result = compare(MODEL, [run for run, _ in logs], stated)
    assert result["overall"]["rmse_mV"] > 10.0
    assert result["overall_fitted_start"]["rmse_mV"] < 1.05
    for said, (_, true) in zip(result["runs"], logs, strict=True):
        assert said["initial_soc"]["value"] == pytest.approx(true, abs=0.005)
        assert said["initial_soc"]["std"] is not None and said["initial_soc"]["std"] < 0.01


def test_slow_states_outside_those_trained_are_counted() -> None:
    trained = replace(MODEL, record=ModelRecord.from_json({"domain": {"slow_current_A": [-0.5, 0.5]}}))
    run = grid_run(np.full(2000, 1.0), 25.0)
    inside = inside_by(trained, run, np.full(2000, 0.5))["slow_current_A"]
    # 1 A through a low-pass of 600 s passes 0.505 A after 422 s.
    assert inside[:420].all() and not inside[423:].any()
    before = Start(0.5, None, StartHistory((0.0, 3600.0), (1.0,)))
    assert not inside_by(trained, run, np.full(2000, 0.5), before)["slow_current_A"].any()
    assert "slow_current_A" not in inside_by(MODEL, run, np.full(2000, 0.5))


def test_the_series_has_a_row_for_each_sample_on_the_grid() -> None:
    logs = [log(np.zeros(1), 1, "a"), log(np.zeros(1), 2, "b")]
    columns = series_columns(MODEL, [run for run, _ in logs], [soc for _, soc in logs])
    names = ["run", "time_s", "current_A", "temperature_degC", "soc", "voltage_V", "simulated_V", "band_V", "inside"]
    assert list(columns) == names
    n = len(logs[0][0])
    assert [len(values) for values in columns.values()] == [2 * n] * len(names)
    assert columns["run"][0] == "a" and columns["run"][-1] == "b" and columns["time_s"][n] == 5.0
    assert set(columns["inside"].tolist()) <= {0, 1}
    # A network that does not say what it does not know has no band.
    assert np.isnan(columns["band_V"]).all()
    assert np.sqrt(np.mean((columns["voltage_V"] - columns["simulated_V"]) ** 2)) < 1.1e-3
