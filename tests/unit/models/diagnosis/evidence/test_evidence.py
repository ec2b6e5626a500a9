import numpy as np
import pytest

from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.reference.penalised import penalised_fit
from models.effects.spline import SplineBasis


def evidence(information: float, seed: int = 0) -> tuple[Evidence, np.ndarray]:
    rng = np.random.default_rng(seed)
    own, x = rng.standard_normal((600, 4)), rng.standard_normal((600, 2))
    error = x @ [0.5, -0.2] + 0.1 * rng.standard_normal(600)
    return Evidence(error, own, information * np.eye(4), np.arange(600) // 30), x


def test_coefficients_and_cost_agree_with_one_dense_problem() -> None:
    found, x = evidence(25.0)
    # The prior as further rows of the same least-squares problem.
    rows = np.vstack([np.hstack([found.regressors, x]), np.hstack([5.0 * np.eye(4), np.zeros((4, 2))])])
    target = np.concatenate([found.error_V, np.zeros(4)])
    dense, cost, *_ = np.linalg.lstsq(rows, target, rcond=None)
    solved = found.solve(x)
    np.testing.assert_allclose(solved.coefficients, dense[4:], rtol=1e-4)
    assert solved.cost == pytest.approx(float(cost[0]), rel=1e-4)


def test_covariance_is_that_of_the_estimates() -> None:
    estimates = []
    for seed in range(200):
        found, x = evidence(1e-6, seed)
        estimates.append(found.solve(x).coefficients)
    found, x = evidence(1e-6)
    expected = 0.1 * np.sqrt(np.diag(found.solve(x).covariance))
    np.testing.assert_allclose(np.std(estimates, axis=0), expected, rtol=0.25)


def test_what_the_model_knows_is_not_bent_and_what_it_does_not_know_is() -> None:
    rng = np.random.default_rng(3)
    own = rng.standard_normal((400, 1))
    error = 0.3 * own[:, 0]
    sure = Evidence(error, own, np.array([[1e9]]), np.arange(400) // 20)
    unsure = Evidence(error, own, np.array([[1e-9]]), np.arange(400) // 20)
    assert sure.cost == pytest.approx(float(error @ error), rel=1e-3)
    assert unsure.cost < 1e-6 * sure.cost
    # A change of the same signal is seen only where the model was sure of it.
    assert sure.solve(own).coefficients[0] == pytest.approx(0.3, rel=1e-3)


def test_held_out_gain_is_there_for_a_signal_and_not_for_noise() -> None:
    found, x = evidence(1.0)
    noise = np.random.default_rng(9).standard_normal((600, 12))
    assert found.gains(x).sum() > 0.9 * (found.null_errors_V**2).sum() - 600 * 0.011
    assert found.gains(noise).sum() < 0.02 * (found.null_errors_V**2).sum()


def test_held_out_error_never_sees_its_own_block() -> None:
    found, x = evidence(1.0)
    spoiled = found.error_V.copy()
    spoiled[(found.blocks % 5) == 0] += 100.0
    # Errors of the other folds move with the spoiled one, its own part keeps the whole jump.
    moved = Evidence(spoiled, found.regressors, found.information, found.blocks)
    own = (found.blocks % 5) == 0
    jump = (moved.null_errors_V - found.null_errors_V)[own]
    assert jump.mean() == pytest.approx(100.0, rel=0.2)


def test_penalties_are_as_strong_as_the_data_make_likely() -> None:
    rng = np.random.default_rng(5)
    x = rng.standard_normal((60, 40))
    y = 2.0 * x[:, 0] + 0.5 * rng.standard_normal(60)
    forms = [1e4 * np.diag([0.0] + [1.0] * 39), np.zeros((40, 40)), np.zeros((40, 40))]
    fit = penalised_fit([x], [y], forms)
    weak = penalised_fit([x], [y], forms, strengths=(1e-10, 1e-10, 1e-10))
    assert np.abs(fit.coefficients[1:]).max() < 0.5 * np.abs(weak.coefficients[1:]).max()
    assert fit.held_out_mse < weak.held_out_mse
    assert fit.own_mse > weak.own_mse


def test_a_bend_that_was_gone_through_once_is_not_smoothed_away() -> None:
    """No stiff curve wins for what it makes of states of charge that were not measured."""
    rng = np.random.default_rng(6)
    soc = np.linspace(0.0, 1.0, 6000)
    basis = SplineBasis(0.0, 1.0, 40)
    true_V = 0.03 * np.tanh((soc - 0.7) / 0.03)
    rough = basis.roughness(3)
    fit = penalised_fit(
        [basis.matrix(soc)],
        [true_V + 1e-3 * rng.standard_normal(len(soc))],
        [(basis.size / 10.0) ** 5 * rough, np.zeros((40, 40)), np.zeros((40, 40))],
    )
    left_V = basis.matrix(soc) @ fit.coefficients - true_V
    assert np.sqrt(np.mean(left_V**2)) < 1.5e-4


def test_a_gain_that_is_seen_at_few_states_of_charge_is_not_let_loose_between_them() -> None:
    """A signal that occurs at two places only: elsewhere its gain stays near what it is there."""
    rng = np.random.default_rng(7)
    soc = np.linspace(0.0, 1.0, 6000)
    basis = SplineBasis(0.0, 1.0, 20)
    signal = rng.standard_normal(6000) * ((np.abs(soc - 0.2) < 0.05) | (np.abs(soc - 0.8) < 0.05))
    forms = [basis.roughness(2), np.eye(20), np.zeros((20, 20))]
    y = 0.02 * signal + 1e-3 * rng.standard_normal(6000)
    fit = penalised_fit([basis.matrix(soc) * signal[:, None]], [y], forms)
    between = basis.matrix(np.linspace(0.25, 0.75, 50)) @ fit.coefficients
    np.testing.assert_allclose(between, 0.02, atol=5e-3)
