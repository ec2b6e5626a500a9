"""Time stamps as loggers, clocks and filters leave them: put right, or left alone where they are right."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import to_grid, typical_interval_s
from models.data.stamps.clock import without_hour_jumps
from models.data.stamps.cut_rests import with_cut_rests
from models.data.stamps.on_change import held_until_next
from models.data.stamps.repair import with_stamps_put_right
from models.data.timeseries import TimeSeries
from tests.unit.models.data.stamps.hand_log import log, part, pulsed

CURRENT_A = pulsed()
RUN = log(CURRENT_A)
LOADED = np.abs(CURRENT_A) > 0.0


def moved_Ah(run: TimeSeries) -> float:
    return float(to_grid(run, 1.0).charge_Ah[-1])


def test_a_good_log_is_left_as_it_is() -> None:
    run, remarks = with_stamps_put_right(RUN)
    assert run is RUN
    assert remarks == []


def test_rests_that_were_cut_out_of_the_samples_are_put_back() -> None:
    cut = part(RUN, LOADED | (RUN.time_s < 30.0))
    assert abs(moved_Ah(cut) - moved_Ah(RUN)) > 0.05
    found = with_cut_rests(cut)
    assert len(found.kept_s) == np.sum(np.diff(cut.time_s) > 3.0)
    assert found.guessed_s == ()
    assert moved_Ah(found.run) == pytest.approx(moved_Ah(RUN), abs=1e-3)
    assert with_cut_rests(found.run).run is found.run
    assert "rest(s) are missing from the log, the longest of 9" in " ".join(with_stamps_put_right(cut)[1])


def test_a_load_that_was_not_logged_is_no_rest() -> None:
    current = np.where(np.arange(3000) < 60, 0.0, -1.0)
    run = log(current)
    gap = part(run, (run.time_s < 1000.0) | (run.time_s > 1400.0))
    assert with_cut_rests(gap).run is gap


def test_a_rest_that_was_cut_out_of_the_time_as_well_is_estimated() -> None:
    current = np.concatenate([np.zeros(60), np.full(600, -2.0), np.zeros(300), np.full(900, -2.0), np.zeros(60)])
    whole = log(current)
    kept = part(whole, (whole.time_s < 660.0) | (whole.time_s >= 960.0))
    anew = replace(kept, time_s=np.arange(len(kept)) * 1.0)
    found = with_cut_rests(anew)
    assert len(found.guessed_s) == 1
    assert 30.0 <= found.guessed_s[0] <= 3600.0
    assert moved_Ah(found.run) == pytest.approx(moved_Ah(whole), abs=1e-3)
    assert "keep the rests in the log" in " ".join(with_stamps_put_right(anew)[1])


def test_a_log_on_change_holds_until_the_next_row() -> None:
    changed = np.abs(np.diff(RUN.voltage_V, prepend=0.0)) > 1e-3
    changed[-1] = True
    on_change = part(RUN, changed | (np.diff(RUN.current_A, prepend=1.0) != 0.0))
    assert len(on_change) < 0.5 * len(RUN)
    held = held_until_next(on_change)
    assert moved_Ah(held) == pytest.approx(moved_Ah(RUN), abs=1e-3)
    assert held_until_next(held) is held
    assert "written on change" in with_stamps_put_right(on_change)[1][0]
    assert typical_interval_s([held]) == 1.0


def test_a_log_on_change_of_a_flat_curve_is_known_as_well() -> None:
    """The row after a change comes late where the voltage hardly moves."""
    current = np.repeat(np.tile([2.0, -2.0], 40), 13)
    run = log(current)
    flat = part(run, np.isin(np.arange(len(run)) % 13, (0, 4)))
    assert "written on change" in with_stamps_put_right(flat)[1][0]
    assert moved_Ah(held_until_next(flat)) == pytest.approx(moved_Ah(run), abs=2e-3)


def test_half_of_the_samples_lost_is_no_log_on_change() -> None:
    half = part(RUN, np.random.default_rng(4).random(len(RUN)) < 0.5)
    assert held_until_next(half) is half


def test_a_sparse_log_with_a_row_at_the_end_of_each_step_holds_backward() -> None:
    edge = np.flatnonzero(np.diff(RUN.current_A) != 0.0)
    kept = np.zeros(len(RUN), bool)
    kept[np.concatenate([edge, edge + 1, np.arange(0, len(RUN), 20), [len(RUN) - 1]])] = True
    sparse = part(RUN, kept)
    assert with_stamps_put_right(sparse)[0] is sparse
    assert moved_Ah(sparse) == pytest.approx(moved_Ah(RUN), abs=1e-6)


@pytest.mark.parametrize("hour_s", [-3600.0, 3600.0])
def test_an_hour_of_the_clock_is_taken_out(hour_s: float) -> None:
    at = int(np.flatnonzero(LOADED[1:] & (np.diff(CURRENT_A) == 0.0))[1000]) + 1
    shown_s = RUN.time_s + hour_s * (np.arange(len(RUN)) >= at)
    time_s, jumps = without_hour_jumps(shown_s, RUN.current_A, RUN.voltage_V)
    assert jumps == [at]
    assert np.array_equal(time_s, RUN.time_s)


def test_an_hour_at_rest_and_other_jumps_are_left() -> None:
    at = 45
    pause_s = RUN.time_s + 3600.0 * (np.arange(len(RUN)) >= at)
    assert without_hour_jumps(pause_s, RUN.current_A, RUN.voltage_V)[1] == []
    back_s = RUN.time_s - 500.0 * (np.arange(len(RUN)) >= 2000)
    assert without_hour_jumps(back_s, RUN.current_A, RUN.voltage_V)[1] == []


@pytest.mark.parametrize("every_s", [1.0, 60.0, 600.0, 900.0, 1800.0, 2400.0])
@pytest.mark.parametrize("times", [1, 2])
def test_an_hour_back_is_taken_out_of_slow_logs_as_well(every_s: float, times: int) -> None:
    """With the lateness of a logger's own clock, twice where a log goes through two autumns."""
    rng = np.random.default_rng(2)
    true_s = every_s * (np.arange(len(RUN)) + rng.uniform(0.0, 0.02, len(RUN)))
    at = [900, 1900][:times]
    shown_s = true_s - 3600.0 * sum(np.arange(len(RUN)) >= k for k in at)
    time_s, jumps = without_hour_jumps(shown_s, RUN.current_A, RUN.voltage_V)
    assert jumps == at
    assert time_s == pytest.approx(true_s)


@pytest.mark.parametrize("every_s", [1.0, 60.0, 600.0, 720.0, 900.0, 1200.0, 1800.0, 2400.0, 3000.0])
@pytest.mark.parametrize("apart", [1, 2, 3, 57])
def test_two_rows_that_changed_places_are_no_clock(every_s: float, apart: int) -> None:
    swapped_s = every_s * np.arange(len(RUN))
    swapped_s[[500, 500 + apart]] = swapped_s[[500 + apart, 500]]
    time_s, jumps = without_hour_jumps(swapped_s, RUN.current_A, RUN.voltage_V)
    assert jumps == []
    assert np.array_equal(time_s, swapped_s)


@pytest.mark.parametrize("every_s", [1.0, 60.0, 900.0])
def test_rows_in_any_order_are_no_clock(every_s: float) -> None:
    shuffled_s = every_s * np.random.default_rng(5).permutation(len(RUN))
    time_s, jumps = without_hour_jumps(shuffled_s, RUN.current_A, RUN.voltage_V)
    assert jumps == []
    assert np.array_equal(time_s, shuffled_s)
