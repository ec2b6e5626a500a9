"""Least squares with bounds, held against scipy's active-set solver."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear, nnls

from models.identification.bounded.box_least_squares import Box, solve


def problem(seed: int, n: int = 80, size: int = 25) -> tuple[np.ndarray, np.ndarray]:
    """Regressors and a target that about half of them explain with the wrong sign."""
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((n, size))
    return a, a @ rng.standard_normal(size) + 0.1 * rng.standard_normal(n)


def positive(bounded: np.ndarray) -> Box:
    """What must not be negative, the others without bounds."""
    return Box(np.where(bounded, 0.0, -np.inf), np.full(len(bounded), np.inf))


@pytest.mark.parametrize("seed", range(8))
def test_all_bounded_is_what_nnls_finds(seed: int) -> None:
    a, y = problem(seed)
    found = solve(a.T @ a, a.T @ y, positive(np.ones(a.shape[1], dtype=bool)))
    reference, _ = nnls(a, y)
    np.testing.assert_allclose(found.x, reference, atol=1e-7 * np.abs(reference).max())
    np.testing.assert_array_equal(found.free, reference > 0.0)


@pytest.mark.parametrize("seed", range(8))
def test_nearly_alike_regressors_fit_as_well_as_with_nnls(seed: int) -> None:
    """Low-passes of neighbouring time constants are all but alike: the sum counts, not which of them has it."""
    a, _ = problem(seed, size=8)
    rng = np.random.default_rng(100 + seed)
    a = np.column_stack([a, a + 1e-5 * rng.standard_normal(a.shape), a[:, 0]])
    y = a @ np.maximum(rng.standard_normal(a.shape[1]), 0.0) + 0.1 * rng.standard_normal(len(a))
    found = solve(a.T @ a, a.T @ y, positive(np.ones(a.shape[1], dtype=bool)))
    reference, residual = nnls(a, y)
    assert (found.x >= 0.0).all()
    assert np.linalg.norm(a @ found.x - y) <= 1.0001 * residual
    np.testing.assert_allclose(a @ found.x, a @ reference, atol=0.02 * np.abs(y).max())


def test_free_ones_may_be_negative_and_the_conditions_of_a_minimum_hold() -> None:
    a, y = problem(3)
    bounded = np.arange(a.shape[1]) % 2 == 0
    found = solve(a.T @ a, a.T @ y, positive(bounded))
    slope = a.T @ (a @ found.x - y)
    scale = np.abs(a.T @ y).max()
    assert (found.x[bounded] >= 0.0).all() and (found.x[~bounded] < 0.0).any()
    assert np.abs(slope[found.free]).max() < 1e-7 * scale
    assert (slope[~found.free] > -1e-7 * scale).all() and found.free[~bounded].all()


def test_where_it_begins_does_not_matter() -> None:
    a, y = problem(5)
    bounded = np.ones(a.shape[1], dtype=bool)
    reference = solve(a.T @ a, a.T @ y, positive(bounded))
    for start in (np.full(len(bounded), -1), -1 * reference.free, reference.side, -reference.side):
        np.testing.assert_allclose(solve(a.T @ a, a.T @ y, positive(bounded), start).x, reference.x, atol=1e-9)


def test_units_of_the_coefficients_do_not_matter() -> None:
    a, y = problem(7)
    bounded = np.ones(a.shape[1], dtype=bool)
    unit = 10.0 ** np.random.default_rng(1).uniform(-6, 6, a.shape[1])
    scaled = solve((a * unit).T @ (a * unit), (a * unit).T @ y, positive(bounded))
    np.testing.assert_allclose(scaled.x * unit, solve(a.T @ a, a.T @ y, positive(bounded)).x, atol=1e-8)


def test_a_signal_that_is_not_there_gets_nothing() -> None:
    a, y = problem(2)
    a[:, 4] = 0.0
    found = solve(a.T @ a, a.T @ y, positive(np.ones(a.shape[1], dtype=bool)))
    assert np.isfinite(found.x).all()
    rest = np.delete(a, 4, axis=1)
    np.testing.assert_allclose(np.delete(found.x, 4), nnls(rest, y)[0], atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_a_box_gives_what_scipy_finds(seed: int) -> None:
    a, y = problem(seed)
    rng = np.random.default_rng(50 + seed)
    lower, upper = -rng.uniform(0.0, 1.0, a.shape[1]), rng.uniform(0.1, 1.0, a.shape[1])
    lower[:5], upper[5:10] = -np.inf, np.inf
    found = solve(a.T @ a, a.T @ y, Box(lower, upper))
    reference = lsq_linear(a, y, (lower, upper), tol=1e-14)
    np.testing.assert_allclose(found.x, reference.x, atol=1e-5)
    assert set(found.side.tolist()) == {-1, 0, 1}
    np.testing.assert_array_equal(found.x[found.side > 0], upper[found.side > 0])
