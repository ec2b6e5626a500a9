"""Least squares with penalties, against small problems written out here."""

import numpy as np
import pytest

from models.diagnosis.reference.penalised import penalised_fit


def problem(n: int = 100, p: int = 3, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((n, p))
    return x, x @ np.arange(1.0, p + 1.0) + 0.1 * rng.standard_normal(n)


def forms(p: int) -> list[np.ndarray]:
    return [np.eye(p), np.zeros((p, p)), np.zeros((p, p))]


def test_a_single_coefficient_shrinks_by_the_strength_per_sample() -> None:
    x = np.full((50, 1), 2.0)
    fit = penalised_fit([x], [np.full(50, 6.0)], forms(1), strengths=(4.0, 1.0, 1.0))
    # Sum of squares 200, of products 600, penalty 50 times 4.
    assert fit.coefficients[0] == pytest.approx(600.0 / (200.0 + 200.0))
    assert fit.penalty[0, 0] == pytest.approx(200.0)
    assert fit.own_mse == pytest.approx((6.0 - 2.0 * 1.5) ** 2)
    assert (fit.n_samples, fit.strengths) == (50, (4.0, 1.0, 1.0))


def held_out_mse(x: np.ndarray, y: np.ndarray, fold: np.ndarray, strength: float) -> float:
    squares = 0.0
    for number in range(5):
        own = fold == number
        kept = x[~own]
        b = np.linalg.solve(kept.T @ kept + strength * len(kept) * np.eye(x.shape[1]), kept.T @ y[~own])
        squares += float(np.sum((y[own] - x[own] @ b) ** 2))
    return squares / len(y)


def test_the_held_out_error_is_that_of_every_fifth_stretch() -> None:
    x, y = problem(200)
    fit = penalised_fit([x], [y], forms(3), strengths=(0.5, 1e-6, 1e-6))
    # A hundred stretches of two samples each.
    assert fit.held_out_mse == pytest.approx(held_out_mse(x, y, np.arange(200) // 2 % 5, 0.5), rel=1e-9)


def test_several_runs_share_the_stretches() -> None:
    x, y = problem(300)
    parts = np.split(np.arange(300), [100])
    fit = penalised_fit([x[part] for part in parts], [y[part] for part in parts], forms(3), strengths=(0.5, 1.0, 1.0))
    # Fifty stretches in each run, each beginning anew.
    fold = np.concatenate([np.arange(100) // 2 % 5, np.arange(200) // 4 % 5])
    assert fit.held_out_mse == pytest.approx(held_out_mse(x, y, fold, 0.5), rel=1e-9)


def log_likelihood(x: np.ndarray, y: np.ndarray, strength: float) -> float:
    """Evidence of the values, a fifth of the samples counted as independent."""
    n, p = x.shape
    prior = strength * n * np.eye(p) + 1e-12 * n * np.eye(p)
    information = x.T @ x + prior
    left = y @ y - (x.T @ y) @ np.linalg.solve(information, x.T @ y)
    grown = np.linalg.slogdet(information)[1] - np.linalg.slogdet(prior)[1]
    return -0.5 * (n / 5.0 * np.log(left) + grown)


@pytest.mark.parametrize("size", [3.0, 1e-3])
def test_the_chosen_strength_makes_the_data_likelier_than_its_neighbours(size: float) -> None:
    rng = np.random.default_rng(4)
    x = rng.standard_normal((500, 10))
    y = x @ (size * rng.standard_normal(10)) + 0.05 * rng.standard_normal(500)
    found = penalised_fit([x], [y], forms(10)).strengths[0]
    best = log_likelihood(x, y, found)
    assert 1e-11 < found < 1e2
    for neighbour in (0.1 * found, 10.0 * found):
        if 1e-11 < neighbour < 1e2:
            assert log_likelihood(x, y, neighbour) <= best


def test_coefficients_that_are_not_there_are_held_down_harder_than_large_ones() -> None:
    rng = np.random.default_rng(6)
    x, noise = rng.standard_normal((500, 10)), 0.05 * rng.standard_normal(500)
    small = penalised_fit([x], [noise], forms(10)).strengths[0]
    large = penalised_fit([x], [x @ np.full(10, 3.0) + noise], forms(10)).strengths[0]
    assert small >= 1e3 * large
