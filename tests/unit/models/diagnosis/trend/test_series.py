"""What persists over a series: neighbours bear each other out, one run alone changes nothing."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.trend.series import change_points, likeliest_set, smoothed, ways_of
from models.diagnosis.trend.weights.sizes import EVERY
from models.diagnosis.trend.weights.weighing import Chances


def run(likely: tuple[str, ...], chance: float, unknown: float = 0.0) -> Chances:
    """A run that speaks for one set with a probability, the others alike."""
    rest = (1.0 - chance - unknown) / (len(EVERY) - 1)
    of = {each: chance if each == likely else rest for each in EVERY}
    return Chances(of.pop(()), unknown, of)


def named(runs: list[Chances]) -> list[tuple[str, ...]]:
    return [EVERY[int(np.argmax(each))] for each in smoothed(runs)]


def test_one_run_alone_is_taken_as_it_is() -> None:
    assert named([run((), 0.9)]) == [()]
    assert named([run(("capacity",), 0.9)]) == [("capacity",)]


def test_neighbours_bear_out_what_each_alone_hardly_tells() -> None:
    hardly = [run(("capacity", "resistance"), 0.4), run(("capacity", "curve"), 0.35)]
    said = named([run((), 0.9)] * 3 + [run(("capacity",), 0.9)] * 3 + [hardly[0], hardly[1], *[hardly[0]] * 3])
    assert said[:3] == [()] * 3
    assert said[3:6] == [("capacity",)] * 3
    assert said[-3:] == [("capacity", "resistance")] * 3


def test_a_single_odd_run_does_not_change_the_cell() -> None:
    series = [run((), 0.9)] * 5 + [run(("resistance",), 0.6)] + [run((), 0.9)] * 5
    assert named(series) == [()] * 11
    assert change_points(series) == []


def test_a_run_that_nothing_explains_says_nothing_of_the_cell() -> None:
    series = [run(("capacity",), 0.9)] * 3 + [run((), 0.0, unknown=0.999)] + [run(("capacity",), 0.9)] * 3
    assert named(series) == [("capacity",)] * 7


def chances(**of: float) -> np.ndarray:
    """Probabilities of sets, their changes joined by underscores."""
    return np.array([of.get("_".join(each), 0.0) for each in EVERY])


def test_a_change_is_named_beside_others_where_it_is_twice_as_likely_as_not() -> None:
    assert likeliest_set(chances(capacity_resistance=0.6, capacity=0.4)) == ("capacity",)
    assert likeliest_set(chances(capacity_resistance=0.7, capacity=0.3)) == ("capacity", "resistance")
    # Which of two it is may be open where it is sure that one is there.
    either = chances(capacity_resistance=0.5, capacity_curve=0.4, capacity=0.1)
    assert likeliest_set(either) == ("capacity", "resistance")
    every = chances(capacity_resistance_curve=0.4, capacity_resistance=0.3, capacity=0.3)
    assert likeliest_set(every) == ("capacity",)
    assert likeliest_set(chances(capacity=0.45, resistance=0.3)) == ("capacity",)


def test_a_change_that_is_hardly_likelier_than_not_has_not_begun() -> None:
    hardly = replace(
        run(("capacity", "resistance"), 0.5), of=run(("capacity", "resistance"), 0.5).of | {("capacity",): 0.4}
    )
    first = [run(("capacity",), 0.95)] * 3
    assert [each.change for each in change_points([*first, hardly])] == ["capacity"]
    assert len(change_points([*first, *[run(("capacity", "resistance"), 0.95)] * 3])) == 2


def test_a_change_point_lies_where_a_change_begins() -> None:
    (point,) = change_points([run((), 0.95)] * 6 + [run(("capacity",), 0.95)] * 6)
    assert (point.change, point.first) == ("capacity", 6)
    assert point.low <= 6 <= point.high and point.high - point.low <= 2
    assert point.probability > 0.9


def lost(first: float, other: float) -> Chances:
    """A run that has lost capacity in the first way or in the third with probabilities, else in none that is known."""
    return replace(run(("capacity",), 0.9), way={0: first, 2: other, -1: 1.0 - first - other})


def test_ways_to_lose_a_capacity_are_borne_out_by_neighbours_that_have_lost_some() -> None:
    runs = [run((), 0.9), lost(0.6, 0.2), lost(0.6, 0.2), lost(0.2, 0.5), lost(0.7, 0.1), run(("capacity",), 0.9)]
    ways = ways_of(runs, smoothed(runs))
    assert ways.sum(axis=1) == pytest.approx(np.ones(len(runs)))
    assert (np.argmax(ways[1:], axis=1) == 0).all() and (ways[1:, 0] > 0.5).all()
