import numpy as np
import pytest
from scipy.optimize import nnls

from models.baselines.normal_equations import Term, accumulate, offsets, solve_bounded
from models.baselines.smoothness import choose, forms, held_out_mse
from models.baselines.tables import locate


@pytest.fixture
def terms() -> list[Term]:
    rng = np.random.default_rng(0)
    soc, degC, n = rng.uniform(-0.1, 1.1, 500), rng.uniform(-20, 40, 500), 500
    current = np.where(rng.random(n) < 0.3, 0.0, rng.normal(size=n))
    along, across = locate(np.linspace(0, 1, 6), soc), locate(np.array([-10.0, 10.0, 30.0]), degC)
    single = locate(np.array([0.5]), soc)
    return [Term(np.ones(n), along, across, is_ocv=True), Term(current, along, across), Term(current, single, across)]


def dense(terms: list[Term]) -> np.ndarray:
    columns = []
    for term in terms:
        for i in range(term.soc.size):
            for j in range(term.temperature.size):
                weights = []
                for axis, knot in ((term.soc, i), (term.temperature, j)):
                    left = np.where(axis.cell == knot, 1.0 - axis.fraction, 0.0)
                    weights.append(left + np.where(axis.cell + 1 == knot, axis.fraction, 0.0))
                columns.append(term.signal * weights[0] * weights[1])
    return np.stack(columns, axis=1)


def test_sums_are_those_of_the_dense_columns(terms: list[Term]) -> None:
    rng = np.random.default_rng(1)
    y, fold = rng.normal(size=500), rng.integers(-1, 3, 500)
    sums, x = accumulate(terms, y, fold, 3), dense(terms)
    assert offsets(terms)[-1] == x.shape[1]
    for f in range(3):
        some = fold == f
        np.testing.assert_allclose(sums.xx[f], x[some].T @ x[some], atol=1e-10)
        np.testing.assert_allclose(sums.xy[f], x[some].T @ y[some], atol=1e-10)
        assert sums.count[f] == some.sum()


@pytest.mark.parametrize("seed", range(8))
def test_bounded_minimum_agrees_with_another_method(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(80, 30)) @ np.diag(rng.uniform(0.01, 3.0, 30))
    y = rng.normal(size=80)
    expected, _ = nnls(x, y)
    found = solve_bounded(x.T @ x, x.T @ y, np.ones(30, dtype=bool))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_what_is_not_bounded_may_be_negative() -> None:
    bounded = np.array([False, True])
    np.testing.assert_allclose(solve_bounded(np.eye(2), np.array([-1.0, -1.0]), bounded), [-1.0, 0.0])


def test_smooth_tables_cost_nothing(terms: list[Term]) -> None:
    parts = forms(terms)
    line = np.linspace(3.0, 4.0, 6).repeat(3)
    even = np.concatenate([line, np.full(18, 0.02), np.full(3, 0.01)])
    for part in parts:
        assert np.linalg.eigvalsh(part).min() > -1e-9 * max(np.abs(part).max(), 1.0)
        assert even @ part @ even == pytest.approx(0.0, abs=1e-9)


def test_chosen_smoothness_predicts_held_out_samples_better(terms: list[Term]) -> None:
    rng = np.random.default_rng(2)
    truth = np.concatenate([np.linspace(3.0, 4.0, 6).repeat(3), np.full(18, 0.02), np.full(3, 0.01)])
    y = dense(terms) @ truth + 0.05 * rng.normal(size=500)
    sums = accumulate(terms, y, rng.integers(0, 5, 500), 5)
    chosen = choose(forms(terms), sums)
    assert chosen.held_out_mse < held_out_mse(sums, 0.0 * chosen.penalty)
    assert chosen.held_out_mse == pytest.approx(0.05**2, rel=0.15)
