"""Charge and discharge of one state of a cell are weighed together."""

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.trend.estimate import seen, weighed
from models.diagnosis.trend.series import ChangePoint, agreed, cycles
from models.diagnosis.trend.weights.latent import COUNT, QUICK
from models.diagnosis.trend.weights.summed import Told, in_units_of
from models.diagnosis.trend.weights.weighing import Chances
from tests.unit.models.diagnosis.known.hand_cell import true_run
from tests.unit.models.diagnosis.trend.test_estimate import FRESH_OHM, whole
from tests.unit.models.hand_network import CAPACITY_AH

__all__ = ["whole"]


def test_a_charge_and_the_discharge_at_its_place_are_one_cycle() -> None:
    at, moved_Ah = np.array([1.0, 1.0, 101.0, 102.0, 102.0, 300.0]), np.array([2.0, -2.0, 2.0, 1.9, -1.9, -1.8])
    assert cycles(at, moved_Ah, 2.0) == [(0, 1), (2,), (3, 4), (5,)]


def test_runs_that_are_counted_are_taken_in_turn() -> None:
    assert cycles(np.arange(1.0, 6.0), np.array([1.0, -1.0, 1.0, -1.0, 1.0]), 1.0) == [(0, 1), (2, 3), (4,)]


def test_the_nearer_of_two_neighbours_is_taken() -> None:
    assert cycles(np.array([10.0, 10.5, 10.6]), np.array([1.0, -1.0, 1.0]), 1.0) == [(0,), (1, 2)]


def test_runs_far_apart_or_that_hardly_move_stay_alone() -> None:
    assert cycles(np.array([92.0, 177.0]), np.array([1.0, -1.0]), 1.0) == [(0,), (1,)]
    assert cycles(np.array([1.0, 2.0]), np.array([1.0, -0.1]), 1.0) == [(0,), (1,)]


def test_what_runs_say_together_lies_between_and_adds_up() -> None:
    one = Chances(0.5, 0.1, {("capacity",): 0.4}, {0: 0.9, -1: 0.1})
    other = Chances(0.1, 0.1, {("capacity",): 0.8})
    both = agreed([one, other])
    assert both.nothing + both.unknown + both.of["capacity",] == pytest.approx(1.0)
    assert other.nothing < both.nothing < one.nothing
    assert both.way == pytest.approx(one.way)
    assert agreed([one]) is one


def test_change_points_are_told_by_the_first_run_of_a_cycle() -> None:
    point = ChangePoint("capacity", 1, 0, 2, 0.99).in_runs([(0, 1), (2, 3), (4,)])
    assert (point.first, point.low, point.high) == (2, 0, 4)


def test_what_another_run_tells_is_the_likelihood_with_its_own_integrated_out() -> None:
    rng = np.random.default_rng(4)
    columns, error = rng.standard_normal((80, COUNT)), rng.standard_normal(80)
    spread = 0.3 * rng.standard_normal((COUNT, COUNT))
    turn = in_units_of(0.03, 0.02)
    assert (turn[QUICK] == pytest.approx(1.5)) and turn[0] == 1.0
    told = Told.of(columns.T @ columns, (columns.T @ error)[:, None], np.array([-0.5 * error @ error]), turn, spread)
    turned = columns * turn
    whole = np.eye(80) + turned @ spread @ spread.T @ turned.T
    for weights in 0.5 * rng.standard_normal((3, COUNT)):
        left = error - turned @ weights
        exact = -0.5 * left @ np.linalg.solve(whole, left) - 0.5 * np.linalg.slogdet(whole)[1]
        got = told.log[0] + told.right[:, 0] @ weights - 0.5 * weights @ told.inner @ weights
        assert got == pytest.approx(exact, rel=1e-9)


def full_run(way: float, grown_Ohm: float) -> GridRun:
    """From empty to full or back at 1C, of a cell that has lost 8 % of its capacity."""
    current_A = np.full(3332, way * CAPACITY_AH)
    current_A[:20] = 0.0
    more_V, capacity_Ah = grown_Ohm * current_A, 0.92 * CAPACITY_AH
    return true_run(current_A, soc=0.5 * (1.0 - way), capacity_Ah=capacity_Ah, added_V=more_V, noise_V=2e-4, seed=3)


def test_both_directions_tell_a_resistance_better_than_one(whole: KnownRuns) -> None:
    grown_Ohm, middle = 0.006, 5
    charge, discharge = (seen(whole, full_run(way, grown_Ohm), 0.5 * (1.0 - way), 0.005) for way in (1.0, -1.0))
    alone, both = weighed(discharge).state, weighed(discharge, charge).state
    assert both.resistance_std_Ohm[middle] < 0.8 * alone.resistance_std_Ohm[middle]
    off = [abs(each.resistance_Ohm[middle] - FRESH_OHM - grown_Ohm) for each in (alone, both)]
    assert max(off) < 0.1 * grown_Ohm
    assert both.capacity_Ah == pytest.approx(0.92 * CAPACITY_AH, rel=0.02)
