"""Knots over the state of charge, and the hats on them."""

import numpy as np
import pytest

from models.identification.bounded.knots import hats, make_knots


def test_they_span_the_trained_range_and_crowd_towards_its_rims() -> None:
    knots = make_knots(0.0, 1.0, 48, 9, 6)
    gaps = np.diff(knots.soc)
    assert (knots.soc[0], knots.soc[-1], len(knots.soc)) == (0.0, 1.0, 48)
    assert (gaps > 0.0).all()
    assert gaps[0] < 0.5 * gaps[24] and gaps[-1] < 0.5 * gaps[24]


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.3, 0.7), (0.49, 0.51), (-0.02, 1.05)])
def test_gains_and_slopes_stand_on_knots_of_the_curve_from_end_to_end(low: float, high: float) -> None:
    knots = make_knots(low, high, 48, 9, 6)
    assert len(knots.soc) >= 4
    for places in (knots.gain, knots.slope):
        assert (places[0], places[-1]) == (0, len(knots.soc) - 1) and (np.diff(places) > 0).all()
    assert len(knots.outer) == len(knots.soc) + 2
    assert knots.outer[0] < low - 0.1 and knots.outer[-1] > high + 0.1


def test_a_part_of_the_range_has_its_share_of_them() -> None:
    whole, part = make_knots(0.0, 1.0, 48, 9, 6), make_knots(0.25, 0.75, 48, 9, 6)
    inside = (whole.soc > 0.25) & (whole.soc < 0.75)
    assert abs(len(part.soc) - inside.sum()) <= 3


def test_hats_sum_to_one_are_straight_between_knots_and_held_beyond() -> None:
    knots, at = np.array([0.1, 0.2, 0.5, 0.9]), np.linspace(-0.2, 1.2, 71)
    found = hats(knots, at)
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    assert found.min() >= 0.0 and ((found > 0.0).sum(axis=1) <= 2).all()
    values = np.array([3.0, 3.5, 3.6, 4.1])
    np.testing.assert_allclose(found @ values, np.interp(at, knots, values), atol=1e-12)
    np.testing.assert_array_equal(hats(knots, knots), np.eye(4))
