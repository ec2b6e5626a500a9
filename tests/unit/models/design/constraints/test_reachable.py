"""Currents and states of charge that leave a way to the end."""

import numpy as np
import pytest

from models.design.constraints.limits import CurrentBounds, InfeasibleError, Limits
from models.design.constraints.reachable import corridor, reachable_bounds

# An ampere for a sample moves a hundredth.
SOC_PER_A = 0.01


def bounds(n: int, low_A: float = -5.0, high_A: float = 5.0) -> CurrentBounds:
    return CurrentBounds(np.full(n, low_A), np.full(n, high_A))


def test_a_load_cycle_is_narrowed_to_the_cells_own_limits() -> None:
    found = reachable_bounds(Limits((-2.0, 3.0)), bounds(3), 1.0)
    np.testing.assert_array_equal(found.low_A, -2.0)
    np.testing.assert_array_equal(found.high_A, 3.0)


def test_from_rest_and_to_rest_by_ramps() -> None:
    # A fall of 1 A/s and a rise of 2 A/s.
    found = reachable_bounds(Limits((-5.0, 5.0), ramp_A_per_s=(-1.0, 2.0)), bounds(5), 1.0)
    np.testing.assert_allclose(found.high_A, [2.0, 4.0, 3.0, 2.0, 1.0])
    np.testing.assert_allclose(found.low_A, [-1.0, -2.0, -3.0, -4.0, -2.0])


def test_a_step_that_no_ramp_follows_is_eased() -> None:
    high = np.array([4.0, 4.0, 1.0, 4.0, 4.0, 4.0, 4.0, 4.0])
    limits = Limits((-5.0, 5.0), ramp_A_per_s=(-1.0, 2.0))
    found = reachable_bounds(limits, CurrentBounds(np.full(8, -5.0), high), 1.0)
    # Where the bound falls by 3 A at once, the current may take its own second for each ampere.
    assert found.high_A[2] == 3.0


def test_bounds_that_cross_leave_no_current() -> None:
    crossed = CurrentBounds(np.array([-1.0, 2.0]), np.array([1.0, 1.0]))
    with pytest.raises(InfeasibleError, match=r"at sample 1 its limits are 2\.\.1 A"):
        reachable_bounds(Limits((-5.0, 5.0)), crossed, 1.0)


def test_a_charge_to_be_given_back_keeps_the_cell_within_reach_of_its_start() -> None:
    limits = Limits((-5.0, 5.0), net_charge_Ah=(0.0, 0.0))
    low, high = corridor(limits, bounds(4), 0.5, SOC_PER_A, 1.0, 1.0)
    # 5 A move a twentieth a sample: three samples before the end it may be three of them away.
    np.testing.assert_allclose(high[1:], 0.5 + np.array([0.15, 0.10, 0.05, 0.0]))
    np.testing.assert_allclose(low[1:], 0.5 - np.array([0.15, 0.10, 0.05, 0.0]))


def test_the_window_holds_throughout() -> None:
    low, high = corridor(Limits((-5.0, 5.0), soc=(0.4, 0.52)), bounds(3), 0.5, SOC_PER_A, 1.0, 1.0)
    np.testing.assert_allclose(low, 0.4, atol=1e-9)
    np.testing.assert_allclose(high, 0.52, atol=1e-9)


def test_a_cycle_that_charges_in_the_end_wants_room_left_for_it() -> None:
    forced = CurrentBounds(np.array([-5.0, 4.0]), np.array([5.0, 5.0]))
    _, high = corridor(Limits((-5.0, 5.0), soc=(0.2, 0.6)), forced, 0.5, SOC_PER_A, 0.5, 1.0)
    # At least 4 A at an efficiency of one half: two hundredths.
    assert high[1] == pytest.approx(0.58, abs=1e-8)


def test_a_cell_outside_its_window_is_told_to_be_brought_back() -> None:
    with pytest.raises(InfeasibleError, match="cell stands at 0.9: charge or discharge it first"):
        corridor(Limits((-5.0, 5.0), soc=(0.1, 0.8)), bounds(3), 0.9, SOC_PER_A, 1.0, 1.0)


def test_more_charge_than_the_current_can_bring_is_a_conflict() -> None:
    limits = Limits((-5.0, 5.0), net_charge_Ah=(1.0, 2.0))
    with pytest.raises(InfeasibleError, match="net_charge_Ah are in conflict"):
        corridor(limits, bounds(4), 0.5, SOC_PER_A, 1.0, 1.0)
    charging = bounds(4, 3.0, 5.0)
    with pytest.raises(InfeasibleError, match="load cycle are in conflict"):
        corridor(Limits((-5.0, 5.0), soc=(0.4, 0.6)), charging, 0.5, SOC_PER_A, 1.0, 1.0)
