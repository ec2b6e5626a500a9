"""Observability and stability against closed forms."""

import numpy as np
import pytest

import models.observer.certificate.stability as stability_module
from models.observer import ObserverSettings
from models.observer.certificate.observability import error_ball, observability, observability_matrix, windowed_gramian
from models.observer.certificate.stability import common_lyapunov, overlapping_pairs, stability
from tests.unit.models.observer.filter.test_gains import network


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_sloping_curve_is_observable_and_its_spread_follows_the_slope(order: int) -> None:
    settings = ObserverSettings(voltage_std_V=1e-9, slow_error_std_V=2e-3)
    seen = observability(network(order), np.array([0.1, 0.9]), settings=settings)
    assert (seen.rank == max(order, 1) + 1).all()
    np.testing.assert_allclose(seen.slope_V, [0.4, 1.0], rtol=0.15)
    np.testing.assert_allclose(seen.soc_std, 2e-3 / seen.slope_V, rtol=1e-6)


def test_the_error_ball_of_a_line_is_error_over_slope_and_a_plateau_is_all_of_it() -> None:
    grid = np.linspace(0.0, 1.0, 1001)
    np.testing.assert_allclose(error_ball(grid, 3.4 + 0.7 * grid, np.array([0.5]), 0.007), 0.01, atol=1.1e-3)
    plateau = 3.3 + np.maximum(grid - 0.8, 0.0)
    np.testing.assert_allclose(error_ball(grid, plateau, np.array([0.2]), 0.01), 0.61, atol=2e-3)
    # A dip that the error reaches across is inside, one that it does not reach ends the ball.
    bent = 3.3 + 0.02 * np.sin(2.0 * np.pi * grid)
    assert error_ball(grid, bent, np.array([0.0]), 0.03)[0] == 1.0
    assert error_ball(grid, bent, np.array([0.0]), 0.01)[0] < 0.1


def test_a_flat_curve_is_blind() -> None:
    flat = np.array([[0.5, 0.0], [0.0, 1.0]])
    assert np.linalg.matrix_rank(observability_matrix(flat)) == 1
    assert windowed_gramian(flat, 100)[1, 1] == 0.0


def test_the_gramian_of_an_integrator_seen_at_once_is_the_slope_squared_times_the_samples() -> None:
    matrix = np.array([[0.0, 0.3], [0.0, 1.0]])
    assert windowed_gramian(matrix, 50)[1, 1] == pytest.approx(50 * 0.09)


def test_a_common_lyapunov_function_is_found_where_there_is_one() -> None:
    turned = np.array([[0.6, 0.5], [-0.3, 0.6]])
    found = common_lyapunov(np.array([turned, 0.8 * np.eye(2), 0.9 * turned.T]))
    assert found.certified
    assert found.contraction <= 1.0
    assert found.margin >= -1e-12


def test_inequalities_prove_what_the_series_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    # Maps that shrink one and the same norm, long in one direction and short in another.
    rng = np.random.default_rng(24)
    root = np.tril(rng.standard_normal((4, 4))) * np.array([1.0, 0.5, 0.3, 0.1])
    left = [1.0 - 10.0 ** rng.uniform(-4.0, -2.0) for _ in range(40)]
    turns = [np.linalg.qr(rng.standard_normal((4, 4)))[0] for _ in left]
    maps = np.array([np.linalg.solve(root.T, k * turn @ root.T) for k, turn in zip(left, turns, strict=True)])
    found = common_lyapunov(maps)
    assert found.certified and found.contraction < 1.0
    monkeypatch.setattr(stability_module, "lyapunov_by_lmi", lambda maps: None)
    assert not common_lyapunov(maps).certified


def test_none_is_claimed_where_switching_grows() -> None:
    # Each map alone is stable, one after the other they grow: no common function can exist.
    up, down = np.array([[0.5, 2.0], [0.0, 0.5]]), np.array([[0.5, 0.0], [2.0, 0.5]])
    assert max(np.abs(np.linalg.eigvals(up @ down))) > 1.0
    found = common_lyapunov(np.array([up, down]))
    assert not found.certified
    assert found.contraction > 1.0
    assert found.spectral_radius < 1.0


def test_the_observer_of_two_local_models_is_stable_in_pairs() -> None:
    settings = ObserverSettings(soc_std_per_sqrt_s=1e-4)
    found = stability(network(1), settings)
    assert found.pairs == len(overlapping_pairs(network(1))) == 3
    assert found.spectral_radius < 1.0
