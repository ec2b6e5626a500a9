import numpy as np
import pytest

from models.data.errors import TimeSeriesError
from models.data.timeseries import TimeSeries

T = np.arange(5.0)
ONES = np.ones(5)


def series(**changes: object) -> TimeSeries:
    columns: dict[str, object] = {"time_s": T, "current_A": ONES, "voltage_V": 3 * ONES, "temperature_degC": 25 * ONES}
    return TimeSeries(**(columns | changes))  # type: ignore[arg-type]


def test_accepts_missing_values_and_keeps_them() -> None:
    voltage = np.array([3.0, np.nan, 3.1, 3.2, 3.3])
    assert np.isnan(series(voltage_V=voltage).voltage_V[1])


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"time_s": np.array([0.0, 1, 1, 2, 3])}, "time does not increase at sample 2"),
        ({"time_s": np.array([0.0, 1, np.nan, 2, 3])}, "time_s is missing at sample 2"),
        ({"voltage_V": 3600 * ONES}, "voltage_V is 3600 at sample 0.*unit"),
        ({"voltage_V": np.array([3.0, 3, np.inf, 3, 3])}, "infinite at sample 2"),
        ({"current_A": np.ones(4)}, "shape"),
        ({"temperature_degC": 300 * ONES}, "unit"),
    ],
)
def test_refuses_what_cannot_be_used(changes: dict[str, np.ndarray], says: str) -> None:
    with pytest.raises(TimeSeriesError, match=says):
        series(**changes)


def test_refuses_one_sample() -> None:
    with pytest.raises(TimeSeriesError, match="at least 2"):
        TimeSeries(np.zeros(1), np.zeros(1), np.ones(1), np.ones(1))
