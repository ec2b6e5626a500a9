import numpy as np
import pytest

from models.design.information.active_models import MarginalPrior, add_products, groups, picked, spread_out, times_block
from models.design.information.criteria import inverse_of

P, MODELS = 3, 6
FIRST = np.array([2, 0, 2, 4, 0])
ROWS = np.random.default_rng(0).standard_normal((5, 2 * P))


def whole() -> np.ndarray:
    out = np.zeros((5, MODELS * P))
    for k, first in enumerate(FIRST):
        out[k, first * P : (first + 2) * P] = ROWS[k]
    return out


def test_samples_are_grouped_by_the_first_local_model_that_counts() -> None:
    found = [(first, np.arange(5)[index].tolist()) for first, index in groups(FIRST)]
    assert found == [(0, [1, 4]), (2, [0, 2]), (4, [3])]
    ((first, index),) = groups(np.array([3, 3]))
    assert first == 3 and np.arange(2)[index].tolist() == [0, 1]


def test_active_entries_stand_for_all() -> None:
    np.testing.assert_array_equal(spread_out(ROWS, FIRST, MODELS, P), whole())
    np.testing.assert_array_equal(picked(whole(), FIRST, 2 * P, P), ROWS)
    total = np.eye(MODELS * P)
    add_products(total, ROWS, FIRST, P, 2.0)
    np.testing.assert_allclose(total, np.eye(MODELS * P) + 2.0 * whole().T @ whole())
    matrix, out = total + total.T, np.empty_like(ROWS)
    times_block(ROWS, FIRST, P, matrix, out)
    np.testing.assert_allclose(out, picked(whole() @ matrix, FIRST, 2 * P, P))


@pytest.mark.parametrize("known", [True, False])
def test_what_a_current_reaches_is_judged_as_with_all_parameters(known: bool) -> None:
    rng = np.random.default_rng(1)
    mixed = rng.standard_normal((MODELS * P, MODELS * P))
    prior = np.eye(MODELS * P) + mixed @ mixed.T if known else np.eye(MODELS * P) / 0.3**2
    begin, end = P, 4 * P
    rows = rng.standard_normal((20, end - begin))
    added = np.zeros_like(prior)
    added[begin:end, begin:end] = rows.T @ rows
    marginal = MarginalPrior(prior if known else None, MODELS * P, 0.3)
    # The second call has what the first one worked out.
    for _ in range(2):
        value, factor = marginal.d_optimality(rows.T @ rows, begin)
        assert value == pytest.approx(np.linalg.slogdet(prior + added)[1])
        np.testing.assert_allclose(inverse_of(factor), np.linalg.inv(prior + added)[begin:end, begin:end], atol=1e-12)
