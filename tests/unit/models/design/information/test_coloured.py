"""What a test tells where errors hang together, against estimates from errors that were drawn so."""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from models.design.information.coloured import told_information, told_over_time
from models.design.information.experiment import Evaluator
from models.design.information.parameters import parameter_std
from models.uncertainty.correlation import ResidualCorrelation
from tests.unit.models.design.networks import experiment, resistive

RNG = np.random.default_rng(3)
CURRENT_A = np.repeat(RNG.uniform(-5.0, 5.0, 60), 10)
MEMORY = ResidualCorrelation(0.2, np.array([0.8]), np.array([0.97]))


def test_white_errors_tell_what_the_information_says() -> None:
    white = replace(experiment(), memory=ResidualCorrelation(1.0, np.zeros(0), np.zeros(0)))
    plain = Evaluator(experiment(), len(CURRENT_A)).information(CURRENT_A)
    assert white.working_V == white.noise_V
    np.testing.assert_allclose(told_information(white, CURRENT_A), plain, rtol=1e-8)
    np.testing.assert_allclose(told_information(experiment(), CURRENT_A), plain, rtol=1e-12)


def test_stated_standard_deviations_are_those_of_estimates() -> None:
    asked = experiment(network=resistive(0), memory=MEMORY, level_V=np.array([1e-3, 2e-3, 4e-3]))
    evaluator = Evaluator(asked, len(CURRENT_A))
    rows, level_V = evaluator.predict(CURRENT_A).sensitivity_V, evaluator.level_V()
    assert 1e-3 < level_V.min() < level_V.max() < 4e-3
    prior, s = asked.prior_information(), asked.working_V**2
    n, plays = len(CURRENT_A), 600
    slow = lfilter([np.sqrt(1.0 - 0.97**2)], [1.0, -0.97], RNG.standard_normal((n + 300, plays)), axis=0)[300:]
    error = level_V[:, None] * (np.sqrt(0.2) * RNG.standard_normal((n, plays)) + np.sqrt(0.8) * slow)
    believed = RNG.standard_normal((len(prior), plays))
    found = np.linalg.solve(prior + rows.T @ rows / s, believed + rows.T @ error / s)
    stated = parameter_std(told_information(asked, CURRENT_A))
    np.testing.assert_allclose(np.sqrt(np.mean(found**2, axis=1)), stated, rtol=0.12)
    # White errors of the same size would promise a multiple of that.
    promised = parameter_std(Evaluator(replace(asked, memory=None), n).information(CURRENT_A))
    assert np.median(stated / promised) > 1.4


def test_pieces_add_up_to_the_whole() -> None:
    asked = experiment(memory=MEMORY)
    *_, last = told_over_time(asked, CURRENT_A, np.array([0, 150, 151, 600]))
    np.testing.assert_allclose(last, told_information(asked, CURRENT_A), rtol=1e-6)
