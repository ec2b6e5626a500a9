import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_service.bench.player import make_player


def test_forward_hold_on_the_grid() -> None:
    player = make_player([0.0, 0.3, 0.5, 0.7], [1.0, -2.0, 0.5, 9.0], 0.1)
    assert player.setpoint_A == (1.0, 1.0, 1.0, -2.0, -2.0, 0.5, 0.5)
    assert player.n_ticks == 7
    assert player.setpoint(6) == 0.5
    assert player.setpoint(7) is None


def test_point_between_ticks_takes_effect_at_the_next_and_the_end_is_never_late() -> None:
    player = make_player([0.0, 0.25, 0.49], [1.0, 2.0, 0.0], 0.1)
    assert player.setpoint_A == (1.0, 1.0, 1.0, 2.0)


def test_times_count_from_the_first_point() -> None:
    assert make_player([100.0, 101.0], [3.0, 0.0], 0.5).setpoint_A == (3.0, 3.0)


def test_steps_shorter_than_a_period_are_counted() -> None:
    assert make_player([0.0, 0.11, 0.12, 1.0], [1.0, 5.0, 2.0, 0.0], 0.1).skipped_points == 1


@given(st.integers(1, 5000), st.sampled_from([0.01, 0.05, 0.1, 0.2, 0.3, 0.7, 1.0, 1.1]))
def test_rounding_costs_no_tick(n_ticks: int, dt_s: float) -> None:
    time_s = np.arange(n_ticks + 1) * dt_s
    current_A = np.arange(n_ticks + 1, dtype=float)
    assert make_player(time_s, current_A, dt_s).setpoint_A == tuple(range(n_ticks))


@pytest.mark.parametrize(
    ("time_s", "current_A", "dt_s", "message"),
    [
        ([0.0], [1.0], 0.1, "two or more"),
        ([0.0, 1.0], [1.0], 0.1, "shapes"),
        ([0.0, np.nan], [1.0, 0.0], 0.1, "finite"),
        ([0.0, 1.0], [np.inf, 0.0], 0.1, "finite"),
        ([0.0, 1.0, 1.0], [1.0, 1.0, 0.0], 0.1, r"time_s\[2\]"),
        ([0.0, 1.0], [1.0, 0.0], 0.0, "period"),
        ([0.0, 0.05], [1.0, 0.0], 0.1, "shorter than one period"),
    ],
)
def test_bad_profiles(time_s: list, current_A: list, dt_s: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_player(time_s, current_A, dt_s)
