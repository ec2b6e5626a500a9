"""Runs have one order, whatever order they were named in."""

from dataclasses import replace

import numpy as np

from models.data.run_order import in_order, run_order
from models.data.timeseries import TimeSeries


def _run(name: str, degC: float, current_A: float, n: int = 50) -> TimeSeries:
    time_s = np.arange(float(n))
    return TimeSeries(time_s, np.full(n, current_A), np.full(n, 3.6), np.full(n, degC), name=name)


RUNS = [_run("hot", 40.0, -1.0), _run("hard", 25.0, 3.0), _run("long", 25.0, -1.0, 80), _run("gentle", 25.0, 1.0)]


def test_by_temperature_then_load_then_length() -> None:
    assert [RUNS[k].name for k in run_order(RUNS)] == ["gentle", "long", "hard", "hot"]


def test_however_they_were_given() -> None:
    for shift in range(4):
        places = np.roll(np.arange(4), shift).tolist()
        runs, soc = in_order([RUNS[k] for k in places], [0.1 * k for k in places])
        assert [run.name for run in runs] == ["gentle", "long", "hard", "hot"]
        np.testing.assert_allclose(soc, [0.3, 0.2, 0.1, 0.0])


def test_runs_alike_stay_as_they_were_given_and_without_temperature_there_is_an_order() -> None:
    one = replace(RUNS[1], temperature_degC=np.full(50, np.nan), name="one")
    assert run_order([one, replace(one, name="other")]) == [0, 1]
    assert run_order([RUNS[1], one]) == [1, 0]
