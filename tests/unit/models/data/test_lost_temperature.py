"""A temperature that is not logged throughout: how long it is unknown, and what is said of it."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.lost_temperature import lost_temperature, without_temperature_s
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries

WHOLE = TimeSeries(np.arange(0.0, 3001.0, 10.0), np.zeros(301), np.full(301, 3.7), np.full(301, 25.0))


def known_where(kept: np.ndarray) -> TimeSeries:
    return replace(WHOLE, temperature_degC=np.where(kept, 25.0, np.nan))


@pytest.mark.parametrize(
    ("kept", "longest_s"),
    [
        (WHOLE.time_s >= 0.0, 0.0),
        (WHOLE.time_s % 60.0 == 0.0, 60.0),
        (WHOLE.time_s < 30.0, 2980.0),
        (WHOLE.time_s > 1000.0, 1010.0),
        ((WHOLE.time_s <= 500.0) | (WHOLE.time_s >= 1500.0), 1000.0),
        (WHOLE.time_s < 0.0, 3000.0),
    ],
    ids=["throughout", "each minute", "lost", "late", "between", "nowhere"],
)
def test_the_longest_time_without_a_temperature(kept: np.ndarray, longest_s: float) -> None:
    run = known_where(kept)
    assert without_temperature_s(run) == to_grid(run, 10.0).without_temperature_s == longest_s
    said = lost_temperature(run)
    assert bool(said) == (longest_s > 600.0 and kept.any())
    assert all(f"{longest_s:.0f} s at a time" in text for text in said)


def test_a_pause_of_the_whole_log_is_no_lost_temperature() -> None:
    pause = np.where((WHOLE.time_s > 500.0) & (WHOLE.time_s < 2500.0), np.nan, 3.7)
    run = replace(known_where(~np.isnan(pause)), voltage_V=pause)
    assert without_temperature_s(run) == 0.0
