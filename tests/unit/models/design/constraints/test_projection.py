import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from models.design.constraints.projection import nearest_within


def problem(n: int, seed: int, tube: float) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    low, high = -rng.uniform(0.0, 3.0, n), rng.uniform(0.0, 3.0, n)
    sum_low, sum_high = np.full(n, -tube * rng.uniform()), np.full(n, tube * rng.uniform())
    return rng.normal(0.5, 4.0, n), low, high, sum_low, sum_high


@settings(max_examples=200, deadline=None)
@given(n=st.integers(1, 60), seed=st.integers(0, 2**32 - 1), tube=st.floats(0.0, 10.0))
def test_it_keeps_the_limits_and_no_feasible_direction_is_nearer(n: int, seed: int, tube: float) -> None:
    wanted, low, high, sum_low, sum_high = problem(n, seed, tube)
    out = np.empty(n)
    nearest_within(wanted, low, high, sum_low, sum_high, out)
    total = np.cumsum(out)
    assert (out >= low - 1e-12).all() and (out <= high + 1e-12).all()
    assert (total >= sum_low - 1e-9).all() and (total <= sum_high + 1e-9).all()
    # Of a projection p of w onto a convex set: (w - p) (x - p) <= 0 for every x of the set, here for scaled others.
    for share in (0.0, 0.5):
        other = np.empty(n)
        nearest_within(share * wanted[::-1].copy(), low, high, sum_low, sum_high, other)
        assert (wanted - out) @ (other - out) <= 1e-7


@pytest.mark.parametrize("seed", range(6))
def test_against_a_quadratic_program(seed: int) -> None:
    n = 15
    wanted, low, high, sum_low, sum_high = problem(n, seed, 3.0)
    out, sums = np.empty(n), np.tril(np.ones((n, n)))
    nearest_within(wanted, low, high, sum_low, sum_high, out)
    constraints = [
        {"type": "ineq", "fun": lambda u: sums @ u - sum_low, "jac": lambda _: sums},
        {"type": "ineq", "fun": lambda u: sum_high - sums @ u, "jac": lambda _: -sums},
    ]
    found = minimize(
        lambda u: 0.5 * np.sum((u - wanted) ** 2),
        np.zeros(n),
        jac=lambda u: u - wanted,
        bounds=list(zip(low, high, strict=True)),
        constraints=constraints,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 300},
    )
    np.testing.assert_allclose(out, found.x, atol=1e-5)
