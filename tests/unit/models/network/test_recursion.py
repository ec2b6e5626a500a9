import numpy as np
import pytest
from scipy.linalg import solve_banded

from models.network.recursion import initial_samples, run_recursion


@pytest.mark.parametrize("order", [0, 1, 2])
def test_recursion_solves_the_banded_triangular_system(order: int) -> None:
    rng = np.random.default_rng(5)
    n = 400
    a = rng.uniform(-0.4, 0.45, size=(n, order)) if order else np.zeros((n, 0))
    f, y = rng.normal(size=n), rng.normal(size=n)
    bands = np.zeros((order + 1, n))
    bands[0] = 1.0
    right = f.copy()
    right[:order] = y[:order]
    for lag in range(1, order + 1):
        bands[lag, : n - lag] = np.where(np.arange(lag, n) >= order, -a[lag:, lag - 1], 0.0)
    expected = solve_banded((order, 0), bands, right)
    np.testing.assert_allclose(run_recursion(a, f, y, np.array([0])), expected, rtol=1e-10, atol=1e-12)


def test_each_part_starts_from_its_own_measurement() -> None:
    a, f = np.full((6, 1), 0.5), np.zeros(6)
    y = np.array([8.0, 0, 0, 4.0, 0, 0])
    np.testing.assert_allclose(run_recursion(a, f, y, np.array([0, 3])), [8, 4, 2, 4, 2, 1])


def test_a_missing_start_becomes_the_static_response() -> None:
    out = run_recursion(np.full((3, 1), 0.5), np.ones(3), np.array([np.nan, 0, 0]), np.array([0]))
    np.testing.assert_allclose(out, [2.0, 2.0, 2.0])


def test_initial_samples_are_marked_in_each_part() -> None:
    np.testing.assert_array_equal(initial_samples(6, np.array([0, 4]), 2), [1, 1, 0, 0, 1, 1])
