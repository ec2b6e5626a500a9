"""Likelihoods of several spreads at once."""

import numpy as np
import pytest

from models.diagnosis.trend.settings import CHANGED, SETTINGS, USUAL
from models.diagnosis.trend.weights.latent import COUNT, root
from models.diagnosis.trend.weights.summed import Sums
from models.diagnosis.trend.weights.weighing import log_of, logs_of

_SAMPLES = 60


def test_each_spread_has_the_likelihood_of_the_gaussian_that_it_stands_for() -> None:
    rng = np.random.default_rng(3)
    columns, error = rng.normal(size=(_SAMPLES, COUNT)), rng.normal(size=_SAMPLES)
    none = np.zeros((0, COUNT))
    log = -0.5 * float(error @ error)
    sums = Sums(1.0, log, columns.T @ columns, columns.T @ error, none, np.zeros(0), np.zeros(0))
    spreads = np.array([root(USUAL), root(CHANGED)])
    # Tempered samples are those of errors with a variance of 1 / power; what no spread changes is taken off.
    variance = 1.0 / SETTINGS.tempering
    expected = []
    for spread in spreads:
        whole = variance * np.eye(_SAMPLES) + columns @ spread @ spread.T @ columns.T
        larger = np.linalg.slogdet(whole)[1] - _SAMPLES * np.log(variance)
        expected.append(-0.5 * float(error @ np.linalg.solve(whole, error)) - 0.5 * float(larger))
    assert logs_of(sums, spreads) == pytest.approx(expected, rel=1e-9)
    assert log_of(sums, spreads[1]) == pytest.approx(expected[1], rel=1e-9)
