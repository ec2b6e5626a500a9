import numpy as np
import pytest

from models.identification.penalty_strengths import Factored, StrengthJudge


@pytest.fixture(scope="module")
def judge() -> StrengthJudge:
    """Ten groups of noisy samples of a truth that one of two penalties agrees with."""
    rng = np.random.default_rng(0)
    n_groups, n, size = 10, 12, 8
    x = rng.normal(size=(n_groups, n, size))
    y = x @ np.repeat([1.0, -1.0], size // 2) + rng.normal(size=(n_groups, n))
    differences = np.diff(np.eye(size // 2), axis=0)
    first, second = np.zeros((2, size, size))
    first[:4, :4] = second[4:, 4:] = differences.T @ differences
    xx, xy = np.einsum("gnp,gnq->gpq", x, x), np.einsum("gnp,gn->gp", x, y)
    return StrengthJudge.of(xx, xy, (y**2).sum(axis=1), np.full(n_groups, float(n)), [first, second])


def log_error(judge: StrengthJudge, at: np.ndarray) -> float:
    return float(np.log(judge.error(at).mse))


def test_derivatives_are_those_of_the_error(judge: StrengthJudge) -> None:
    at, step = np.array([-1.3, -0.4]), 1e-4
    found = judge.error(at)
    moves = step * np.eye(2)
    gradient = [(log_error(judge, at + move) - log_error(judge, at - move)) / (2 * step) for move in moves]
    hessian = [(judge.error(at + move).gradient - judge.error(at - move).gradient) / (2 * step) for move in moves]
    np.testing.assert_allclose(found.gradient, gradient, rtol=1e-5)
    np.testing.assert_allclose(found.hessian, hessian, rtol=1e-5, atol=1e-8)


def test_the_choice_is_as_good_as_a_grid_search(judge: StrengthJudge) -> None:
    grid = [judge.error(np.array([i, j])).mse for i in np.arange(-6.0, 1.5) for j in np.arange(-6.0, 1.5)]
    at, mse = judge.best(None)
    assert mse <= 1.005 * min(grid)
    assert mse == pytest.approx(judge.error(at).mse)


def test_a_hopeless_start_is_given_up(judge: StrengthJudge) -> None:
    start = (-9.0, -9.0)
    _, mse = judge.best(start, hopeless_mse=0.5 * judge.best(start)[1])
    assert mse == pytest.approx(judge.error(np.array(start)).mse)


def test_a_singular_matrix_is_solved_as_well_as_can_be() -> None:
    singular = np.diag([2.0, 0.0, -1e-6])
    solved = Factored.of(singular).solve(np.array([4.0, 0.0, 0.0]))
    np.testing.assert_allclose(solved, [2.0, 0.0, 0.0], atol=1e-6)
