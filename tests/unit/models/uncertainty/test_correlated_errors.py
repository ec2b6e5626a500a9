import numpy as np
import pytest
from scipy.signal import lfilter

from models.uncertainty.correlated_errors import least_squares_covariance


@pytest.mark.parametrize(("rho", "tolerance"), [(0.0, 0.15), (0.6, 0.2), (0.9, 0.3)])
def test_standard_deviations_are_those_of_repeated_fits(rho: float, tolerance: float) -> None:
    """A line and a slow sine under first-order autoregressive noise, fitted 300 times."""
    rng = np.random.default_rng(3)
    n = 3000
    x = np.column_stack([np.ones(n), np.linspace(-1.0, 1.0, n), np.sin(np.arange(n) / 200.0)])
    estimates, stated = [], []
    for _ in range(300):
        noise = lfilter([1.0], [1.0, -rho], rng.standard_normal(n))
        parameters = np.linalg.lstsq(x, noise, rcond=None)[0]
        estimates.append(parameters)
        stated.append(np.sqrt(np.diag(least_squares_covariance(x, noise - x @ parameters))))
    np.testing.assert_allclose(np.mean(stated, axis=0), np.std(estimates, axis=0), rtol=tolerance)


def test_white_noise_in_closed_form() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal((20_000, 2))
    residual = 0.3 * rng.standard_normal(20_000)
    residual -= x @ np.linalg.lstsq(x, residual, rcond=None)[0]
    covariance = least_squares_covariance(x, residual)
    np.testing.assert_allclose(np.diag(covariance), 0.09 / 20_000, rtol=0.05)


def test_runs_do_not_reach_into_one_another() -> None:
    """Two runs with opposite offsets: products across their border would take back what each of them says."""
    x = np.ones((2000, 1))
    residual = np.concatenate([np.full(1000, 1.0), np.full(1000, -1.0)])
    apart = least_squares_covariance(x, residual, (0, 1000))
    joined = least_squares_covariance(x, residual)
    assert apart[0, 0] > 1.02 * joined[0, 0] > 10.0 * residual.var() / 2000
