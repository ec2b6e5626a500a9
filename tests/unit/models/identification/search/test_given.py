"""A structure that a person gives is kept; poles and size are chosen."""

from dataclasses import replace

import pytest

from models.identification.search.given import GivenCandidate, pole_alternatives, poles_for, size_alternatives
from models.network.structure import full_structure, minimal_structure


@pytest.mark.parametrize(
    ("order", "slow_s", "fastest_s", "poles_s"),
    [
        (0, 25.0, 2.0, ()),
        (1, 25.0, 2.0, (25.0,)),
        (1, 1.0, 2.0, (2.0,)),  # nothing is faster than the samples tell
        (2, 40.0, 2.0, (5.0, 40.0)),
        (2, 10.0, 2.0, (2.0, 10.0)),
        (2, 1.0, 2.0, (2.0, 2.0)),
    ],
)
def test_poles_of_an_order(order: int, slow_s: float, fastest_s: float, poles_s: tuple[float, ...]) -> None:
    assert poles_for(order, slow_s, fastest_s) == poles_s


def test_other_poles_leave_structure_and_size_alone() -> None:
    best = GivenCandidate(minimal_structure(1.0), (7.0,), 18)
    others = pole_alternatives(best, 2.0)
    assert [each.poles_s for each in others] == [(4.0,), (10.0,), (25.0,), (60.0,)]
    assert all(each.given is best.given and each.n_models == 18 for each in others)


def test_sizes_are_tried_where_something_may_be_split() -> None:
    best = GivenCandidate(full_structure(1.0), (7.0,))
    assert [each.n_models for each in size_alternatives(best)] == [6, 12, 18, 24, 30, 36]
    whole = replace(best.given, axes=tuple(replace(axis, splittable=False) for axis in best.given.axes))
    fixed = replace(best, given=whole)
    assert size_alternatives(fixed) == [fixed]


def test_the_structure_takes_the_sampling_time_of_the_runs() -> None:
    candidate = GivenCandidate(minimal_structure(1.0), (7.0,))
    assert candidate.structure(0.5) == replace(candidate.given, dt_s=0.5)
    assert candidate.to_json() == {"structure": "minimal", "poles_s": [7.0], "n_models": 12}
