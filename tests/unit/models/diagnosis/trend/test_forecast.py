"""A capacity followed beyond its runs: right where it goes on as it did, and wide where nobody knows."""

import numpy as np
import pytest

from models.data.errors import ModelError
from models.diagnosis.trend.forecast import Forecast, forecast

FRESH_AH = 2.0


def followed(place: np.ndarray, loss: np.ndarray, seed: int = 1, end: float = 0.8) -> Forecast:
    rng = np.random.default_rng(seed)
    capacity_Ah = FRESH_AH * (1.0 - loss + 2e-3 * rng.normal(size=len(place)))
    found = forecast(place, capacity_Ah, FRESH_AH, end, "cycle")
    assert found is not None
    return found


def test_a_straight_loss_ends_where_the_line_does() -> None:
    place = np.arange(0.0, 300.0, 10.0)
    found = followed(place, place / 2000.0)
    assert found.at == pytest.approx(400.0, rel=0.07)
    assert found.low is not None and found.low < 400.0 < (found.high or np.inf)
    assert not found.reached and "expected" in found.words


def test_the_band_grows_beyond_the_runs() -> None:
    place = np.arange(0.0, 300.0, 10.0)
    found = followed(place, place / 2000.0)
    width = found.high_Ah - found.low_Ah
    assert width[-1] > 3.0 * width[len(width) // 2] > 3.0 * width[len(width) // 4]
    assert found.place[-1] == pytest.approx(580.0)


def test_an_end_too_far_away_is_not_told() -> None:
    place = np.arange(0.0, 300.0, 10.0)
    found = followed(place, place / 20_000.0)
    assert found.at is None and "not within the data" in found.words
    assert found.to_json()["within_data"] is False


def test_an_end_that_was_reached_is_told_as_such() -> None:
    place = np.arange(0.0, 600.0, 10.0)
    found = followed(place, place / 2000.0)
    assert found.reached and found.at == pytest.approx(400.0, rel=0.05)
    assert "was reached" in found.words


def test_bands_hold_what_they_say_where_the_slope_wanders() -> None:
    inside = []
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        slope = 4e-4 + np.cumsum(rng.normal(size=60)) * 3e-5
        life = np.cumsum(slope) * 5.0
        place = np.arange(60.0)
        found = forecast(place[:40], FRESH_AH * (1.0 - life[:40]), FRESH_AH, 0.8, "run")
        assert found is not None
        low, high = (np.interp(55.0, found.place, each) for each in (found.low_Ah, found.high_Ah))
        inside.append(low <= FRESH_AH * (1.0 - life[55]) <= high)
    assert 0.85 <= np.mean(inside)


def test_few_places_tell_nothing_and_falling_ones_are_refused() -> None:
    assert forecast(np.array([1.0, 1.0, 2.0, 3.0]), np.full(4, 2.0), FRESH_AH, 0.8, "run") is None
    with pytest.raises(ModelError, match="time's order"):
        forecast(np.array([1.0, 5.0, 2.0, 6.0]), np.full(4, 2.0), FRESH_AH, 0.8, "cycle")
