"""Parameters near old ones that fit new runs: how much the old count, and how alike neighbours change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray
from models.identification.output_error import normal_equations, on_inputs, stabilised
from models.identification.shared_poles import penalties
from models.identification.stored_sums import StoredSums
from models.network.local_model_network import LocalModelNetwork
from models.network.recursion import free_run, initial_samples
from models.network.regression import Dataset

# How much a sample of an old run counts beside one of a new one; tried from full trust to nearly none.
_OLD_WEIGHTS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.001)
# Pull of neighbouring local models' changes towards each other, over the number of new samples; the first is used while
# the weight of the old runs is chosen.
_ALIKE = (1e-2, 1e-4, 1e-3, 1e-1, 1.0)
_ITERATIONS = 12
_TRIALS = 10


@dataclass(frozen=True)
class Solution:
    """New parameters, and how they were held to the old ones.

    Attributes
    ----------
    theta : (M, p)
    old_weight : how much an old sample counts beside a new one
    alike : pull of neighbouring local models' changes towards each other
    old_weights, alikes : held-out RMSE in normalised units of each that was tried
    """

    theta: FloatArray
    old_weight: float
    alike: float
    old_weights: dict[float, float]
    alikes: dict[float, float]


def solved(
    network: LocalModelNetwork, data: Dataset, old: StoredSums | None, old_weight: float | None = None
) -> Solution:
    """Choose both weights on held-out blocks of the new runs, and solve.

    Parameters
    ----------
    network : the model so far
    data : regression arrays of the new runs
    old : what the old runs said; None: only that the parameters were what they are
    old_weight : given, not chosen
    """
    with threadpool_limits(1, user_api="blas"):
        problem = _Problem(network, data, old)
        tried = {w: problem.held_out(w, _ALIKE[0]) for w in (_OLD_WEIGHTS if old_weight is None else (old_weight,))}
        weight = min(tried, key=tried.__getitem__)
        tried_alike = {_ALIKE[0]: tried[weight]} | {a: problem.held_out(weight, a) for a in _ALIKE[1:]}
        alike = min(tried_alike, key=tried_alike.__getitem__)
        theta = problem.solve(weight, alike, np.ones(len(data)))
    return Solution(theta, weight, alike, tried, tried_alike)


class _Problem:
    """Squared error of the new runs, and the quadratic forms that hold the parameters near the old ones."""

    def __init__(self, network: LocalModelNetwork, data: Dataset, old: StoredSums | None) -> None:
        self._network, self._data = network, data
        self._order = network.structure.output_order
        self._validity = network.partition.validity(data.z)
        self._is_start = initial_samples(len(data), data.starts, self._order) > 0
        self._centre = stabilised(network.theta, self._order)
        size = network.theta.size
        self._old = np.zeros((size, size)) if old is None else old.information
        forms = penalties(network.structure, network.partition, data, network.theta[:, : self._order].mean(axis=0))
        self._alike = on_inputs(np.sum(forms, axis=0), network.theta.shape, self._order) * len(data)

    def held_out(self, weight: float, alike: float) -> float:
        """RMSE in normalised units on blocks of the new runs that the trial did not see."""
        group = self._data.groups()
        total, count = 0.0, 0
        for parity in (0, 1):
            held = group % 2 == parity
            theta = self.solve(weight, alike, (~held).astype(np.float64))
            error = (free_run(theta, self._order, self._validity, self._data) - self._data.y)[held]
            known = error[~np.isnan(error)]
            total += float(known @ known)
            count += len(known)
        return float(np.sqrt(total / max(count, 1)))

    def solve(self, weight: float, alike: float, weights: FloatArray) -> FloatArray:
        """Gauss-Newton with damping from the old parameters; (M, p)."""
        shape, centre = self._centre.shape, self._centre.ravel()
        share = float(weights.mean())
        network, order = self._network, self._order
        first = normal_equations(centre.reshape(shape), order, network.partition, self._data, weights)
        # Directions that neither new nor old runs excite stay where they are.
        floor = 1e-6 * np.trace(first.information) / len(centre) * np.eye(len(centre))
        hold = weight * self._old + alike * share * self._alike + floor

        def cost(x: FloatArray) -> float:
            away = x - centre
            return self._squared_error(x.reshape(shape), weights) + float(away @ hold @ away)

        x, value, damping = centre, cost(centre), 1e-6
        for _ in range(_ITERATIONS):
            equations = normal_equations(x.reshape(shape), order, network.partition, self._data, weights)
            hessian = equations.information + hold
            gradient = equations.gradient - hold @ (x - centre)
            for _ in range(_TRIALS):
                step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient)
                trial = stabilised((x + step).reshape(shape), self._order).ravel()
                trial_value = cost(trial)
                if np.isfinite(trial_value) and trial_value < value:
                    break
                damping = max(10.0 * damping, 1e-6)
            else:
                break
            small = value - trial_value < 1e-5 * value
            x, value, damping = trial, trial_value, 0.1 * damping
            if small:
                break
        return x.reshape(shape)

    def _squared_error(self, theta: FloatArray, weights: FloatArray) -> float:
        error = self._data.y - free_run(theta, self._order, self._validity, self._data)
        return float(weights @ np.where(np.isnan(error) | self._is_start, 0.0, error) ** 2)
