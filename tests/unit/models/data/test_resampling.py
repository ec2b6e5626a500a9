from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from models.data.resampling import to_grid, typical_interval_s
from models.data.timeseries import TimeSeries


def uneven(seed: int, n: int = 200) -> TimeSeries:
    rng = np.random.default_rng(seed)
    t = np.concatenate([[0.0], np.cumsum(rng.choice([0.1, 0.5, 1.0, 3.0], n - 1))])
    return TimeSeries(t, rng.normal(size=n), 3.5 + 0.1 * rng.normal(size=n), np.full(n, 25.0))


def test_a_reference_is_known_between_its_values_only() -> None:
    time_s = np.arange(6.0)
    told = np.array([np.nan, 0.5, np.nan, 0.52, np.nan, np.nan])
    run = TimeSeries(time_s, np.ones(6), np.full(6, 3.7), np.full(6, 25.0), None, told)
    reference = to_grid(run, 1.0).soc_ref
    assert reference is not None
    assert np.array_equal(np.isnan(reference), [True, False, False, False, True, True])
    assert reference[2] == 0.51


@given(st.integers(0, 10_000))
def test_charge_is_kept_to_the_last_grid_point(seed: int) -> None:
    run = uneven(seed)
    grid = to_grid(run, 1.0)
    charge = np.concatenate([[0.0], np.cumsum(run.current_A[1:] * np.diff(run.time_s))])
    expected = np.interp(grid.time_s[-1], run.time_s, charge) / 3600.0
    assert abs(grid.charge_Ah[-1] - expected) < 1e-12
    assert abs(grid.current_A[1:].sum() / 3600.0 - expected) < 1e-12


def test_voltage_is_not_invented_in_a_pause_of_the_log() -> None:
    t = np.concatenate([np.arange(0.0, 10.0), np.arange(70.0, 80.0)])
    run = TimeSeries(t, np.zeros(20), np.full(20, 3.7), np.full(20, 25.0))
    grid = to_grid(run, 1.0)
    assert np.isnan(grid.voltage_V[10:70]).all()
    assert not np.isnan(grid.voltage_V[:10]).any()
    assert grid.n_missing == 60
    assert grid.segment_starts == (0,)  # at rest the current is known all along


def test_a_pause_between_different_currents_cuts_the_run() -> None:
    t = np.concatenate([np.arange(0.0, 10.0), np.arange(200.0, 210.0)])
    current = np.concatenate([np.full(10, 2.0), np.full(10, -3.0)])
    grid = to_grid(TimeSeries(t, current, np.full(20, 3.7), np.full(20, 25.0)), 1.0)
    assert grid.segment_starts == (0, 200)


def test_even_samples_stay_as_they_are() -> None:
    n = 50
    rng = np.random.default_rng(3)
    run = TimeSeries(np.arange(n) * 0.5, rng.normal(size=n), 3 + rng.normal(size=n) * 0.1, np.full(n, 20.0))
    grid = to_grid(run, 0.5)
    np.testing.assert_allclose(grid.current_A, run.current_A, atol=1e-12)
    np.testing.assert_allclose(grid.voltage_V, run.voltage_V, atol=1e-12)


def test_typical_interval_is_a_round_number() -> None:
    t = np.cumsum(np.full(100, 0.97))
    assert typical_interval_s([TimeSeries(t, np.zeros(100), np.full(100, 3.0), np.zeros(100))]) == 1.0


def test_a_log_slower_than_the_grid_is_told_next_to_its_samples() -> None:
    """Each sample once, where the voltage hardly bends: not across a step of the current, not at a knee."""
    t = np.arange(0.0, 900.0, 9.4)
    current = np.where(t > 95.0, -4.0, 0.0)

    def true_V(at: np.ndarray) -> np.ndarray:
        knee = np.where(at > 800.0, 1e-3 * (at - 800.0) ** 2, 0.0)
        return 4.0 - 2e-4 * at - np.where(at > 95.0, 0.2, 0.0) - knee

    grid = to_grid(TimeSeries(t, current, true_V(t), np.full(len(t), 25.0)), 2.0)
    told = grid.time_s[grid.measured]
    assert 0.8 * len(t) < len(told) < len(t)
    assert not grid.measured[(grid.time_s > 94.0) & (grid.time_s < 100.0)].any()
    assert np.abs(grid.voltage_V - true_V(grid.time_s))[grid.measured].max() < 6e-4


def resistor(time_s: np.ndarray, rng: np.random.Generator) -> TimeSeries:
    """A log of 50 mOhm in series with 3.7 V, the current another one in each interval."""
    current = rng.uniform(-4.0, 2.0, len(time_s))
    return TimeSeries(time_s, current, 3.7 + 0.05 * current, np.full(len(time_s), 25.0))


def test_a_jittered_log_has_its_voltage_with_the_current_of_the_same_interval() -> None:
    rng = np.random.default_rng(0)
    run = resistor(np.concatenate([[0.0], np.cumsum(rng.uniform(0.6, 1.4, 2000))]), rng)
    grid = to_grid(run, 1.0)
    distance_s = np.abs(grid.time_s[:, None] - run.time_s[None, :]).min(axis=1)
    after = np.minimum(np.searchsorted(run.time_s, grid.time_s), len(run) - 1)
    changed = np.abs(run.current_A[after] - run.current_A[after - 1]) > 0.05
    between = grid.measured & changed & (distance_s > 0.01)
    assert between.sum() > 1900
    np.testing.assert_allclose(grid.voltage_V[between], 3.7 + 0.05 * grid.current_A[between], atol=1e-9)


def test_an_even_log_beside_the_grid_stays_a_straight_line() -> None:
    time_s = np.concatenate([[0.0], np.arange(300) + 0.4])
    run = resistor(time_s, np.random.default_rng(1))
    grid = to_grid(run, 1.0)
    straight_V = np.interp(grid.time_s, run.time_s, run.voltage_V)
    np.testing.assert_allclose(grid.voltage_V, straight_V, atol=1e-12)
    np.testing.assert_allclose(straight_V, 3.7 + 0.05 * grid.current_A, atol=1e-9)


def test_a_current_that_was_lost_is_told_apart_from_a_sample_here_and_there() -> None:
    t = np.arange(100.0)
    whole = TimeSeries(t, np.sin(t), np.full(100, 3.7), np.full(100, 25.0))
    assert to_grid(whole, 1.0).current_known is None
    current_A = whole.current_A.copy()
    current_A[20] = current_A[50:70] = np.nan
    for dt_s, lost in ((1.0, slice(50, 70)), (2.0, slice(26, 35))):
        grid = to_grid(replace(whole, current_A=current_A), dt_s)
        known = np.ones(len(grid), dtype=bool)
        known[lost] = False
        assert grid.current_known is not None
        np.testing.assert_array_equal(grid.current_known, known)
        np.testing.assert_array_equal(np.isnan(grid.logged_current_A), ~known)
        # To others it is the last one, as ever.
        np.testing.assert_allclose(grid.current_A[lost][1:], current_A[49])


def test_a_current_is_not_lost_where_the_log_has_it_less_often() -> None:
    t = np.arange(100.0)
    run = TimeSeries(t, np.where(t % 10.0 == 0.0, 1.0, np.nan), np.full(100, 3.7), np.full(100, 25.0))
    assert to_grid(run, 1.0).current_known is None


def test_before_the_first_current_none_is_known() -> None:
    current_A = np.ones(50)
    current_A[:10] = np.nan
    known = to_grid(TimeSeries(np.arange(50.0), current_A, np.full(50, 3.7), np.full(50, 25.0)), 1.0).current_known
    assert known is not None
    np.testing.assert_array_equal(np.flatnonzero(~known), np.arange(10))
    nothing = TimeSeries(np.arange(50.0), np.full(50, np.nan), np.full(50, 3.7), np.full(50, 25.0))
    known = to_grid(nothing, 1.0).current_known
    assert known is not None and not known.any()
