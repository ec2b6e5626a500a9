from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.design.constraints.feasible import Demands
from models.design.constraints.limits import Limits
from models.design.information.experiment import Evaluator, Experiment
from models.design.information.rival_experiment import RivalEvaluator
from models.design.optimise.ascent import optimise
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.design.networks import resistive
from tests.unit.models.hand_network import hats, network

N = 80
LIMITS = Limits((-5.0, 5.0), (0.2, 0.8))


def slow() -> Experiment:
    """One local model with a slow overpotential that the other rival knows nothing of."""
    inputs = (InputChannel("soc", delay=1), InputChannel("current"), InputChannel("low_pass:30"))
    structure = Structure(0, inputs, (PartitionAxis("soc"),), 10.0)
    return Experiment(network(structure, np.array([[0.5, 0.03, 0.02, 3.3]])), 0.5, 1e-3, prior_std=0.1)


def quick() -> Experiment:
    inputs = (InputChannel("soc", delay=1), InputChannel("current"))
    structure = Structure(0, inputs, (PartitionAxis("soc"),), 10.0)
    return Experiment(network(structure, np.array([[0.5, 0.05, 3.3]])), 0.5, 1e-3, prior_std=0.1)


def excitation(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.choice([-1.0, 1.0], N) * rng.uniform(0.5, 4.0, N)


def of_hats() -> Experiment:
    """Hats, of which the current reaches some; what is known beforehand hangs together over all of them."""
    model = hats()
    mixed = np.random.default_rng(1).standard_normal((model.theta.size, model.theta.size))
    prior = 100.0 * (np.eye(model.theta.size) + mixed @ mixed.T / model.theta.size)
    return Experiment(replace(model, structure=replace(model.structure, dt_s=10.0)), 0.5, 1e-3, prior=prior)


def test_hats_separate_as_if_all_parameters_were_refitted() -> None:
    first, second = of_hats(), quick()
    evaluator, current = RivalEvaluator(first, second, N), 3.0 * excitation()
    predictions = [Evaluator(each, N).predict(current) for each in (first, second)]
    difference = (predictions[1].voltage_V - predictions[0].voltage_V) / 1e-3
    psi, prior = predictions[0].sensitivity_V / 1e-3, first.prior_information()
    moved = np.linalg.solve(psi.T @ psi + prior, psi.T @ difference)
    expected = float(np.sum((difference - psi @ moved) ** 2) + moved @ prior @ moved)
    assert evaluator.separation(current)[1] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("rivals", [(slow, quick), (quick, slow), (of_hats, quick), (quick, of_hats)])
def test_gradient_against_central_differences(rivals: tuple) -> None:
    evaluator, current, step = RivalEvaluator(rivals[0](), rivals[1](), N), excitation(), 1e-4
    evaluator.value(current)
    gradient = evaluator.gradient()
    moved = [evaluator.value(current + step * e) - evaluator.value(current - step * e) for e in np.eye(N)]
    assert np.abs(gradient - np.array(moved) / (2.0 * step)).max() < 1e-5 * np.abs(gradient).max()


def test_separation_by_hand() -> None:
    """What a least-squares refit with the same prior leaves."""
    first, second = slow(), quick()
    evaluator, current = RivalEvaluator(first, second, N), excitation()
    predictions = [each.predict(current) for each in evaluator._evaluators]
    difference = (predictions[0].voltage_V - predictions[1].voltage_V) / 1e-3
    stacked = np.vstack([predictions[1].sensitivity_V / 1e-3, 10.0 * np.eye(3)])
    target = np.concatenate([difference, np.zeros(3)])
    coefficients, *_ = np.linalg.lstsq(stacked, target, rcond=None)
    left = target - stacked @ coefficients
    assert evaluator.separation(current)[0] == pytest.approx(float(left @ left), rel=1e-9)


def test_the_designed_current_separates_more_than_random_ones() -> None:
    evaluator = RivalEvaluator(slow(), quick(), N)
    found = optimise(slow(), Demands(LIMITS), N, n_starts=5, criterion=evaluator)
    random = max(evaluator.value(5.0 * np.repeat(np.sign(excitation(s)[:40]), 2)) for s in range(10))
    assert found.value > random
    assert min(evaluator.separation(found.current_A)) > 1.0


def test_the_same_model_twice_cannot_be_told_apart() -> None:
    evaluator = RivalEvaluator(slow(), slow(), N)
    np.testing.assert_allclose(evaluator.separation(excitation()), 0.0, atol=1e-12)


def test_rivals_need_one_sampling_time() -> None:
    with pytest.raises(ModelError, match="sampling times"):
        RivalEvaluator(slow(), Experiment(resistive(dt_s=1.0), 0.5, 1e-3), N)
