"""Likelihood of innovations against the joint normal distribution of a free run's errors."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from models.data.timeseries import FloatArray
from models.observer.tuning.innovations import TuningData, log_likelihood

DT_S = 2.0
# Voltage, quick error and its time, slow error, its time and SoC, drift of the SoC, resistance.
VALUES = np.array([1e-3, 2e-3, 6.0, 3e-3, 40.0, 0.02, 1e-4, 0.05])


def test_it_is_the_density_of_all_errors_of_each_run_together() -> None:
    rng = np.random.default_rng(3)
    data = TuningData(
        error_V=rng.normal(0.0, 3e-3, 24),
        slope_V=rng.uniform(0.3, 2.0, 24),
        level=rng.uniform(0.5, 1.5, 24),
        moved=rng.uniform(0.0, 5e-3, 24),
        overpotential_V=rng.normal(0.0, 0.05, 24),
        starts=np.array([0, 15]),
        dt_s=DT_S,
    )
    data.error_V[[4, 5, 20]] = np.nan
    expected = density(data, slice(0, 15)) + density(data, slice(15, 24))
    # The constant of the normal distribution is left out: nothing is compared across numbers of samples.
    constant = 0.5 * np.log(2.0 * np.pi) * np.isfinite(data.error_V).sum()
    assert log_likelihood(data, VALUES) == pytest.approx(expected + constant, rel=1e-9)


def density(data: TuningData, part: slice) -> float:
    """Of the errors of one run, from the covariance of what they consist of."""
    voltage, quick, quick_s, slow, slow_s, slow_soc, drift, resistance = VALUES
    error, slope, level, over = (each[part] for each in (data.error_V, data.slope_V, data.level, data.overpotential_V))
    n = len(error)
    steps = np.arange(n)
    fading = np.cumsum(np.append(0.0, DT_S / slow_s + data.moved[part][1:] / slow_soc))
    quick_kept = np.exp(-np.abs(steps[:, None] - steps) * DT_S / quick_s)
    slow_kept = np.exp(-np.abs(fading[:, None] - fading))
    walked = drift**2 * DT_S * np.minimum(steps[:, None], steps)
    covariance = (
        outer(slope) * walked
        + quick**2 * outer(level) * quick_kept
        + (slow**2 * outer(level) + resistance**2 * outer(over)) * slow_kept
        + voltage**2 * np.eye(n)
    )
    known = np.isfinite(error)
    return float(multivariate_normal(cov=covariance[np.ix_(known, known)]).logpdf(error[known]))


def outer(values: FloatArray) -> FloatArray:
    return np.outer(values, values)
