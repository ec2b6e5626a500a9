"""Times as text, against the calendar of the standard library."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pytest

from bench_service.exchange.foreign.times import (
    TimeTextError,
    clock_s,
    date_order,
    durations_s,
    excel_s,
    has_zone,
    kind_of_times,
)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("0:00:00", 0), ("26:03:04.5", 93784.5), ("1d 02:03:04", 93784), ("1.02:03:04,25", 93784.25), ("1:30", 5400)],
)
def test_durations(text: str, seconds: float) -> None:
    assert kind_of_times([text]) == "duration"
    np.testing.assert_allclose(durations_s(pa.array([text, None, ""])), [seconds, np.nan, np.nan])


@pytest.mark.parametrize(
    "form",
    ["%Y-%m-%d %H:%M:%S", "%Y/%m/%dT%H:%M:%S", "%d.%m.%Y %H:%M:%S", "%d-%b-%y %I:%M:%S %p", "%d/%m/%Y %H:%M:%S"],
)
def test_dates_of_five_years(form: str) -> None:
    start = datetime(2019, 12, 30, 23, 59, 58, tzinfo=UTC)
    moments = [start + timedelta(days=37 * k, seconds=4567 * k) for k in range(50)]
    texts = [moment.strftime(form) for moment in moments]
    assert kind_of_times(texts) == "clock"
    assert date_order(texts) == "day-first"
    found = clock_s(pa.array([*texts, None]), "day-first")
    np.testing.assert_array_equal(found[:-1], [moment.timestamp() for moment in moments])
    assert np.isnan(found[-1])


def test_an_offset_from_utc_is_taken_off() -> None:
    assert clock_s(pa.array(["2024-03-01T12:00:00+01:30", "2024-03-01 12:00:00Z"]), "day-first").tolist() == [
        1709289000.0,
        1709294400.0,
    ]


def test_every_form_that_names_its_offset_is_seen() -> None:
    same = ["2024-03-01T12:00:00+01:30", "01-Mar-2024 12:00:00 +0130", "01.03.2024 12:00:00 +01:30"]
    for text in same:
        assert has_zone([text]) and not has_zone([text[:-6]])
        assert clock_s(pa.array([text]), "day-first").tolist() == [1709289000.0]


def test_excel_counts_from_its_own_day() -> None:
    assert excel_s(np.array([45351.5]))[0] == datetime(2024, 2, 29, 12, tzinfo=UTC).timestamp()


def test_what_is_no_time_is_named() -> None:
    with pytest.raises(TimeTextError, match="soon"):
        durations_s(pa.array(["0:00:01", "soon"]))
    with pytest.raises(TimeTextError, match="13/13/2024"):
        clock_s(pa.array(["01/02/2024 10:00", "13/13/2024 10:00"]), "day-first")
    assert kind_of_times(["0:00:01", "soon"]) is None
    assert date_order(["03/04/2024"]) is None
    assert date_order(["03/14/2024"]) == "month-first"
