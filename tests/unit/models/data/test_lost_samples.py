"""Samples that were lost at random are put back with the likeliest current; other logs are left as they are."""

import numpy as np

from models.data.lost_samples import tick_s, with_lost_samples
from models.data.resampling import to_grid, typical_interval_s
from tests.unit.models.data.stamps.hand_log import log, part, pulsed

RUN = log(pulsed(4000, 20, 20))


def test_half_of_the_samples_lost() -> None:
    kept = np.random.default_rng(2).random(len(RUN)) < 0.5
    kept[[0, -1]] = True
    half = part(RUN, kept)
    assert tick_s(half.time_s) == 1.0
    assert typical_interval_s([half]) == 1.0
    back = with_lost_samples(half)
    assert len(back) == len(RUN)
    assert np.array_equal(back.current_A[kept], RUN.current_A[kept])
    assert np.isnan(back.voltage_V[~kept]).all()
    grid = to_grid(half, 1.0)
    assert np.abs(grid.charge_Ah - to_grid(RUN, 1.0).charge_Ah).max() < 0.015
    assert grid.n_missing == int((~kept).sum())


def test_a_whole_log_is_left_as_it_is() -> None:
    assert tick_s(RUN.time_s) is None
    assert with_lost_samples(RUN) is RUN
    jittered = RUN.time_s + np.random.default_rng(3).uniform(-0.2, 0.2, len(RUN))
    assert tick_s(np.sort(jittered)) is None


def test_a_log_that_changes_its_pace_has_lost_nothing() -> None:
    pace = np.concatenate([np.full(300, 1.0), np.full(200, 2.0), np.full(300, 1.0), np.full(200, 5.0)])
    assert tick_s(np.cumsum(pace)) is None
    assert tick_s(np.arange(5.0)) is None
    assert tick_s(np.cumsum(np.where(np.arange(1000) % 10 == 0, 0.1, 1.0))) is None
