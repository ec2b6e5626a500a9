"""Parameters of hats that are free at some knots only."""

import json

import numpy as np
import pytest

from models.uncertainty.expansion import Expansion

CENTRES = np.array([-0.4, 0.1, 0.2, 0.4, 0.7, 0.9, 1.4])
GAIN, CURVE = (1, 3, 5), (1, 2, 3, 4, 5)
KNOWN = Expansion(CENTRES, (GAIN, CURVE))


def expanded(values: np.ndarray) -> np.ndarray:
    """(M, p) parameters at all knots."""
    return (KNOWN.matrix() @ values).reshape(len(CENTRES), 2)


def test_a_gain_is_straight_between_its_knots_and_held_beyond() -> None:
    values = np.concatenate([[1.0, 3.0, 2.0], np.zeros(5)])
    np.testing.assert_allclose(expanded(values)[:, 0], np.interp(CENTRES, CENTRES[list(GAIN)], [1.0, 3.0, 2.0]))
    assert expanded(values)[0, 0] == 1.0 and expanded(values)[-1, 0] == 2.0


def test_the_curve_goes_on_as_it_ended() -> None:
    curve = np.array([3.0, 3.3, 3.4, 3.5, 3.9])
    column = expanded(np.concatenate([np.zeros(3), curve]))[:, 1]
    np.testing.assert_allclose(column[1:-1], curve)
    assert (column[1] - column[0]) / 0.5 == pytest.approx((3.3 - 3.0) / 0.1)
    assert (column[-1] - column[-2]) / 0.5 == pytest.approx((3.9 - 3.5) / 0.2)


def test_size_counts_the_free_ones_column_after_column() -> None:
    assert KNOWN.size == 8 and KNOWN.matrix().shape == (14, 8)
    only = expanded(np.eye(8)[3])
    assert (only[:, 0] == 0.0).all() and only[1, 1] == 1.0


def test_the_document_comes_back() -> None:
    again = Expansion.from_json(json.loads(json.dumps(KNOWN.to_json(), allow_nan=False)))
    assert again.places == KNOWN.places
    np.testing.assert_array_equal(again.matrix(), KNOWN.matrix())


@pytest.mark.parametrize("damage", [{"centres": ["a"]}, {"places": [["x"]]}, {"places": None}])
def test_a_damaged_document_raises(damage: dict[str, object]) -> None:
    with pytest.raises((TypeError, ValueError)):
        Expansion.from_json(KNOWN.to_json() | damage)
