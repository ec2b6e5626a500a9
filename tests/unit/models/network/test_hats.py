from typing import Any

import numpy as np
import pytest

from models.data.errors import StructureError
from models.network import hats

_INTERVAL: Any = hats.hat_interval
_SLOPE: Any = hats.hat_slope
KNOTS = np.array([0.0, 0.02, 0.1, 0.5, 0.9])
CENTRES = KNOTS[:, None]


@pytest.mark.parametrize(
    ("z", "below", "share", "slope"),
    [
        (-1.0, 0, 0.0, 0.0),
        (0.0, 0, 0.0, 50.0),
        (0.01, 0, 0.5, 50.0),
        (0.02, 1, 0.0, 12.5),
        (0.2, 2, 0.25, 2.5),
        (0.9, 3, 1.0, 0.0),
        (7.0, 3, 1.0, 0.0),
    ],
)
def test_the_interval_is_found_with_the_upper_knots_weight(z: float, below: int, share: float, slope: float) -> None:
    found, weight = _INTERVAL(CENTRES, z)
    assert found == below
    assert weight == pytest.approx(share)
    assert pytest.approx(slope) == _SLOPE(CENTRES, below, z)


def test_every_knot_is_found_among_many() -> None:
    knots = np.sort(np.random.default_rng(0).uniform(size=50))
    z = np.linspace(-0.1, 1.1, 1001)
    expected = np.clip(np.searchsorted(knots, z, side="right") - 1, 0, 48)
    assert [_INTERVAL(knots[:, None], value)[0] for value in z] == expected.tolist()


def test_boxes_reach_half_as_far_as_the_nearer_neighbour() -> None:
    lower, upper = hats.boxes_around(KNOTS)
    np.testing.assert_allclose(upper[:, 0] - KNOTS, [0.01, 0.01, 0.04, 0.2, 0.2])
    np.testing.assert_allclose(hats.knots_of(lower, upper), KNOTS, atol=1e-16)


def test_hats_over_two_axes_are_refused() -> None:
    with pytest.raises(StructureError, match="one axis"):
        hats.knots_of(np.zeros((3, 2)), np.ones((3, 2)))
