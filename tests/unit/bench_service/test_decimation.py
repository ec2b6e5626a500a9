"""Thinning keeps what a person would look for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench_service.store.decimation import kept_rows


def test_a_single_spike_in_a_million_survives() -> None:
    voltage_V = np.full(1_000_000, 3.7)
    voltage_V[765_432] = 4.3
    voltage_V[123_456] = 2.4
    rows = kept_rows({"voltage_V": voltage_V}, len(voltage_V), 1000, ["voltage_V"])
    assert len(rows) <= 1000
    assert {123_456, 765_432, 0, 999_999} <= set(rows.tolist())


def test_extremes_of_each_column_survive() -> None:
    voltage_V, current_A = np.full(10_000, 3.7), np.zeros(10_000)
    voltage_V[77], current_A[8_001], current_A[8_500] = 3.1, 5.0, -5.0
    rows = kept_rows({"voltage_V": voltage_V, "current_A": current_A}, 10_000, 100, ["voltage_V", "current_A"])
    assert len(rows) <= 100 and {77, 8_001, 8_500} <= set(rows.tolist())


def test_missing_values_are_no_extremes() -> None:
    voltage_V = np.full(1000, np.nan)
    voltage_V[500:510] = np.arange(10) + 3.0
    rows = kept_rows({"voltage_V": voltage_V}, 1000, 20, ["voltage_V"])
    assert {500, 509, 0, 999} <= set(rows.tolist())


def test_short_streams_stay_as_they_are() -> None:
    assert kept_rows({"a": np.arange(5.0)}, 5, 5, ["a"]).tolist() == [0, 1, 2, 3, 4]
    assert kept_rows({"a": np.arange(0.0)}, 0, 10, ["a"]).tolist() == []


@pytest.mark.parametrize("max_points", [0, 1, 2, 3])
def test_the_ends_are_always_kept(max_points: int) -> None:
    assert kept_rows({"a": np.arange(50.0)}, 50, max_points, ["a"]).tolist() == [0, 49]


@given(
    arrays(np.float64, st.integers(1, 300), elements=st.floats(-10, 10) | st.just(np.nan)),
    st.integers(4, 60),
)
def test_rows_rise_and_hold_the_range(values: np.ndarray, max_points: int) -> None:
    rows = kept_rows({"a": values}, len(values), max_points, ["a"])
    assert len(rows) <= max(max_points, 2) and (np.diff(rows) > 0).all()
    if not np.isnan(values).all():
        assert np.nanmin(values[rows]) == np.nanmin(values)
        assert np.nanmax(values[rows]) == np.nanmax(values)


def test_steps_stay_where_they_were_as_long_as_they_are_few() -> None:
    setpoint_A = np.zeros(100_000)
    setpoint_A[[40_000, 40_001]] = np.nan  # missing twice is one step there and one back
    setpoint_A[61_234:71_234] = 5.0
    columns = {"current_A": setpoint_A, "setpoint_A": setpoint_A}
    rows = set(kept_rows(columns, 100_000, 200, ["current_A"], ["setpoint_A", "step"]).tolist())
    assert {61_233, 61_234, 71_233, 71_234, 39_999, 40_000, 40_001, 40_002} <= rows and len(rows) <= 200
    noisy = np.arange(100_000.0) % 2
    assert len(kept_rows({"setpoint_A": noisy}, 100_000, 200, [], ["setpoint_A"])) <= 200


def test_a_pulse_in_a_million_samples_has_its_true_length_when_zoomed_to_ten_minutes() -> None:
    time_s = np.arange(6000) * 0.1
    setpoint_A = np.where((time_s >= 200.0) & (time_s < 300.0), 5.0, 0.0)
    rows = kept_rows({"setpoint_A": setpoint_A, "current_A": setpoint_A}, 6000, 300, ["current_A"], ["setpoint_A"])
    shown_s, shown_A = time_s[rows], setpoint_A[rows]
    edges = shown_s[1:][np.diff(shown_A) != 0]
    assert edges.tolist() == pytest.approx([200.0, 300.0])
