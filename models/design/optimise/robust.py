"""A criterion that counts at several networks: the reference may be wrong by as much as is not known of it.

What a current tells of a network without output feedback does not depend on its parameters; there one is enough.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.design.information.experiment import Evaluator, Experiment
from models.design.optimise.ascent import Objective
from models.network.local_model_network import LocalModelNetwork

_DRAWS = 2
# Networks with a pole beyond this are not drawn: their free run would go astray.
_LARGEST_POLE = 0.9999


class MeanCriterion:
    """Mean of a criterion over several experiments."""

    def __init__(self, experiments: list[Experiment], n_samples: int, criterion: str) -> None:
        self._evaluators = [Evaluator(each, n_samples, criterion) for each in experiments]

    def value(self, current_A: FloatArray) -> float:
        """Mean value; larger is better."""
        return float(np.mean([evaluator.value(current_A) for evaluator in self._evaluators]))

    def gradient(self) -> FloatArray:
        """(N,) mean derivative at the current whose value was asked for last, in 1/A."""
        return np.mean([evaluator.gradient() for evaluator in self._evaluators], axis=0)


def robust_criterion(experiment: Experiment, n_samples: int, criterion: str, seed: int) -> str | Objective:
    """Criterion at the reference and at draws from what is known of it; by its name where one network is enough."""
    network = experiment.network
    if network.structure.output_order == 0 or experiment.prior is None:
        return criterion
    factor = np.linalg.cholesky(experiment.prior)
    rng, drawn = np.random.default_rng([seed, 5]), [experiment]
    for _ in range(_DRAWS):
        moved = np.linalg.solve(factor.T, rng.standard_normal(len(factor))).reshape(network.theta.shape)
        other = replace(network, theta=network.theta + moved)
        if _stable(other):
            drawn.append(replace(experiment, network=other))
    return MeanCriterion(drawn, n_samples, criterion) if len(drawn) > 1 else criterion


def _stable(network: LocalModelNetwork) -> bool:
    order = network.structure.output_order
    companion = np.zeros((network.n_models, order, order))
    companion[:, 0] = network.theta[:, :order]
    companion[:, 1:, :-1] += np.eye(order - 1)
    return bool(np.abs(np.linalg.eigvals(companion)).max() < _LARGEST_POLE)
