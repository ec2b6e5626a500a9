import numpy as np
import pytest
from scipy.optimize import minimize

from models.data.errors import ModelError
from models.design.constraints.feasible import Demands
from models.design.constraints.limits import Limits
from models.design.information.criteria import efficiency
from models.design.information.experiment import Evaluator
from models.design.optimise.ascent import optimise
from tests.unit.models.design.networks import experiment

LIMITS = Limits(current_A=(-6.0, 4.0), soc=(0.1, 0.9))
N = 150


def random_binary_A(n: int, seed: int, hold: int) -> np.ndarray:
    levels = np.random.default_rng(seed).choice([-4.0, 4.0], -(-n // hold))
    return np.repeat(levels, hold)[:n]


@pytest.mark.parametrize("criterion", ["A", "D", "E"])
def test_it_beats_random_binary_currents_of_every_speed(criterion: str) -> None:
    found = optimise(experiment(), Demands(LIMITS), N, criterion=criterion, n_starts=6)
    evaluator = Evaluator(experiment(), N, criterion)
    random = [evaluator.value(random_binary_A(N, seed, hold)) for seed in range(5) for hold in (1, 3, 10, 30)]
    assert found.value > max(random)
    assert found.value == pytest.approx(evaluator.value(found.current_A), rel=1e-12)
    assert found.starts[found.finished].max() == pytest.approx(found.value, rel=1e-6)
    assert found.finished.sum() >= 1 and found.spread >= 0.0


def test_a_quasi_newton_method_with_the_same_gradient_gets_no_further() -> None:
    open_window = Limits(current_A=LIMITS.current_A)
    found = optimise(experiment(), Demands(open_window), N, n_starts=8)
    evaluator = Evaluator(experiment(), N)

    def negative(current: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = evaluator.value_and_gradient(current)
        return -value, -gradient

    start = np.random.default_rng(0).uniform(*LIMITS.current_A, N)
    other = minimize(negative, start, jac=True, method="L-BFGS-B", bounds=[LIMITS.current_A] * N)
    assert efficiency(found.value, -other.fun, 15) > 0.99
    assert found.optimality < 1e-2


def test_the_seed_decides_all() -> None:
    one, two, other = (optimise(experiment(), Demands(LIMITS), N, n_starts=3, seed=seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one.current_A, two.current_A)
    np.testing.assert_array_equal(one.starts, two.starts)
    assert not np.array_equal(one.current_A, other.current_A)


def test_progress_rises_to_the_end() -> None:
    shares: list[float] = []
    optimise(experiment(), Demands(LIMITS), 40, n_starts=4, progress=lambda share, text: shares.append(share))
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0)


def test_what_is_known_already_is_not_asked_again() -> None:
    """With all local models but the lowest known, the charge goes down to it."""
    known = np.full(15, 1e8)
    known[:5] = 1e-2
    focused = optimise(experiment(prior=np.diag(known)), Demands(LIMITS), N, n_starts=6)
    soc = 0.5 + np.cumsum(focused.current_A) * 10.0 / 7200.0
    assert np.median(soc) < 0.4


def test_bad_requests_are_refused() -> None:
    with pytest.raises(ModelError, match="at least one"):
        optimise(experiment(), Demands(LIMITS), N, n_starts=0)
    with pytest.raises(ModelError, match="duration"):
        optimise(experiment(), Demands(LIMITS), 0)
    with pytest.raises(ModelError, match="criterion"):
        optimise(experiment(), Demands(LIMITS), N, criterion="T")
    with pytest.raises(ModelError, match="noise"):
        experiment(noise_V=0.0)
    with pytest.raises(ModelError, match="parameters"):
        experiment(prior=np.eye(3))
