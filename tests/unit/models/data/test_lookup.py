import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from models.data.lookup import line, place, surface, volume

LAYERS, ROWS, COLUMNS = np.array([-4.0, -1.0, 2.0]), np.array([0.0, 20.0]), np.array([0.1, 0.4, 0.5, 0.9])
VALUES = np.random.default_rng(0).uniform(1.0, 2.0, (3, 2, 4))


def test_inside_it_is_multilinear_interpolation() -> None:
    reference = RegularGridInterpolator((LAYERS, ROWS, COLUMNS), VALUES)
    rng = np.random.default_rng(1)
    for point in rng.uniform([-4.0, 0.0, 0.1], [2.0, 20.0, 0.9], (50, 3)):
        assert volume(LAYERS, ROWS, COLUMNS, VALUES, *point) == pytest.approx(reference(point)[0], abs=1e-12)


def test_beyond_the_ends_the_nearest_point_counts() -> None:
    assert volume(LAYERS, ROWS, COLUMNS, VALUES, -9.0, 50.0, 2.0) == VALUES[0, 1, 3]
    assert volume(LAYERS, ROWS, COLUMNS, VALUES, 9.0, -50.0, -2.0) == VALUES[2, 0, 0]


def test_columns_go_on_as_a_line_where_asked() -> None:
    slope = (VALUES[0, 1, 3] - VALUES[0, 1, 2]) / 0.4
    assert surface(ROWS, COLUMNS, VALUES[0], 99.0, 1.1, True) == pytest.approx(VALUES[0, 1, 3] + 0.2 * slope)
    assert surface(ROWS, COLUMNS, VALUES[0], 99.0, 1.1, False) == VALUES[0, 1, 3]


def test_an_axis_of_one_point_is_a_constant() -> None:
    one = np.array([25.0])
    assert place(one, -100.0, True) == (0, 0.0)
    assert line(one, np.array([7.0]), 1e9, True) == 7.0
    assert volume(one, one, COLUMNS, VALUES[:1, :1], 0.0, 0.0, 0.4) == VALUES[0, 0, 1]
