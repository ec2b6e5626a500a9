"""A criterion at several networks that the reference might be."""

import numpy as np

from models.design.information.experiment import Evaluator
from models.design.optimise.robust import MeanCriterion, robust_criterion
from tests.unit.models.design.networks import experiment, resistive

CURRENT_A = np.random.default_rng(1).uniform(-4.0, 4.0, 60)
KNOWN = np.eye(resistive().theta.size) * 1e4


def test_without_output_feedback_one_network_is_enough() -> None:
    asked = experiment(network=resistive(0), prior=np.eye(resistive(0).theta.size))
    assert robust_criterion(asked, 60, "D", 0) == "D"
    assert robust_criterion(experiment(), 60, "D", 0) == "D"


def test_value_and_gradient_are_means_over_draws() -> None:
    asked = experiment(prior=KNOWN)
    found = robust_criterion(asked, 60, "D", 0)
    assert isinstance(found, MeanCriterion)
    value, step = found.value(CURRENT_A), 1e-5
    assert value != Evaluator(asked, 60).value(CURRENT_A)
    gradient = found.gradient()
    for k in (3, 30):
        moved = CURRENT_A.copy()
        moved[k] += step
        np.testing.assert_allclose((found.value(moved) - value) / step, gradient[k], rtol=1e-3, atol=1e-6)


def test_networks_that_would_go_astray_are_not_drawn() -> None:
    assert robust_criterion(experiment(prior=np.eye(len(KNOWN)) * 1e-4), 60, "D", 0) == "D"
