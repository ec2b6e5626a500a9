"""Runs that follow each other as one log, and the pauses between them."""

from dataclasses import replace

import numpy as np
import pytest

from bench_service.campaign.designing import pauses_between_s
from bench_service.jobs.joining import joined
from bench_service.store.records import RunRecord
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries


def series(name: str, first_A: float, ambient: bool = True) -> TimeSeries:
    time_s = 5.0 + np.arange(40.0)
    current = np.where((time_s > 10.0) & (time_s < 40.0), first_A, 0.0)
    degC = np.full(40, 25.0)
    return TimeSeries(time_s, current, 3.7 + 0.01 * current, degC, degC if ambient else None, name=name)


def test_one_log_with_a_rest_in_between() -> None:
    log = joined([series("a", 1.0), series("b", -2.0)], [300.0])
    assert log.name == "a then b" and len(log) == 80 and log.ambient_degC is not None
    assert log.time_s[40] - log.time_s[39] == 300.0 and log.time_s[0] == 0.0
    grid = to_grid(log, 1.0)
    # No part of its own: the model goes through the pause, of which it knows no voltage.
    assert grid.segment_starts == (0,)
    pause = (grid.time_s > 39.0) & (grid.time_s < 339.0)
    assert not grid.measured[pause].any() and not grid.current_A[pause].any()
    charge_As = [float(np.sum(each.current_A)) for each in (series("a", 1.0), series("b", -2.0))]
    assert 3600.0 * grid.charge_Ah[-1] == pytest.approx(sum(charge_As))


def test_ambient_is_known_where_all_know_it() -> None:
    assert joined([series("a", 1.0), series("b", 1.0, ambient=False)], [1.0]).ambient_degC is None
    alone = series("a", 1.0)
    assert joined([alone], []) is alone


def test_the_clock_tells_how_long_a_cell_rested() -> None:
    first = RunRecord(
        id="a",
        bench="b",
        profile_id="p",
        state="completed",
        dt_s=2.0,
        created_utc="2026-01-01T00:00:00.000Z",
        started_utc="2026-01-01T00:00:01.000Z",
        ended_utc="2026-01-01T01:00:00.000Z",
        initial_soc=0.5,
        capacity_Ah=2.5,
        limits={},
        code_version="1",
    )
    second = replace(first, id="b", started_utc="2026-01-01T01:00:30.000Z")
    assert pauses_between_s([first, second], lock_step=False) == [30.0]
    assert pauses_between_s([first, second], lock_step=True) == [2.0]
    assert pauses_between_s([first, replace(second, started_utc=None)], lock_step=False) == [2.0]
    assert pauses_between_s([first], lock_step=False) == []
