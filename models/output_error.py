"""Refinement on the free-run error: Levenberg-Marquardt with exact sensitivities, regularised, kept stable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from models.free_run import initial_samples, run_recursion, sensitivity_block
from models.local_model_network import blend, free_run
from models.partition import Partition
from models.regression import Dataset
from models.timeseries import FloatArray

_BLOCK = 2048
_POLE_LIMIT = 0.9995


@dataclass(frozen=True)
class Refinement:
    """Result of a refinement.

    Attributes
    ----------
    theta : (M, p) refined parameters
    rmse : free-run RMSE on the refined data, normalised units
    iterations : accepted steps
    converged : whether the last step was small rather than the budget spent
    """

    theta: FloatArray
    rmse: float
    iterations: int
    converged: bool


def refine(
    theta: FloatArray,
    order: int,
    partition: Partition,
    data: Dataset,
    penalty: FloatArray,
    towards_start: float,
    weights: FloatArray | None = None,
    max_iterations: int = 30,
    on_iteration: Callable[[int, float], None] | None = None,
) -> Refinement:
    """Minimise the squared free-run error.

    Parameters
    ----------
    theta : (M, p) start values
    order : output order n
    partition : validity functions' boxes
    data : training samples
    penalty : (M q, M q) quadratic penalty on the input parameters, as the shared-pole fit has it
    towards_start : pull of every parameter towards its start, relative to the information that the data have of it
    weights : (N,) weight of each sample; missing voltages always count 0
    max_iterations : budget of steps
    on_iteration : called with the number of accepted steps and the RMSE

    Returns
    -------
    Refinement
        Never worse than the start on the penalised cost.
    """
    with threadpool_limits(1, user_api="blas"):
        problem = _Problem(order, partition, data, weights)
        start = stabilised(theta, order)
        information = problem.normal_equations(start).information
        ridge = towards_start * np.diag(np.diag(information))
        return _iterate(problem, start, ridge, on_inputs(penalty, theta.shape, order), max_iterations, on_iteration)


def on_inputs(penalty: FloatArray, shape: tuple[int, int], order: int) -> FloatArray:
    """Spread a penalty on input parameters over all parameters; past outputs are left free."""
    n_models, p = shape
    index = np.concatenate([np.arange(order, p) + i * p for i in range(n_models)])
    spread = np.zeros((n_models * p, n_models * p))
    spread[np.ix_(index, index)] = penalty
    return spread


def _iterate(
    problem: _Problem,
    start: FloatArray,
    ridge: FloatArray,
    smooth: FloatArray,
    max_iterations: int,
    on_iteration: Callable[[int, float], None] | None,
) -> Refinement:
    shape, x0 = start.shape, start.ravel()

    def penalised(x: FloatArray) -> float:
        away = x - x0
        return problem.cost(x.reshape(shape)) + float(away @ ridge @ away + x @ smooth @ x)

    x, cost, damping, accepted, converged = x0, penalised(x0), 1e-4, 0, False
    while accepted < max_iterations and not converged:
        equations = problem.normal_equations(x.reshape(shape))
        hessian = equations.information + ridge + smooth
        gradient = equations.gradient - ridge @ (x - x0) - smooth @ x
        for _ in range(12):
            damped = hessian + damping * np.diag(np.diag(hessian) + 1e-12 * np.trace(hessian))
            candidate = stabilised((x + np.linalg.solve(damped, gradient)).reshape(shape), problem.order).ravel()
            candidate_cost = penalised(candidate)
            if np.isfinite(candidate_cost) and candidate_cost < cost:
                break
            damping *= 8.0
        else:
            converged = True
            break
        converged = cost - candidate_cost < 1e-4 * cost
        x, cost, damping, accepted = candidate, candidate_cost, max(damping / 6.0, 1e-10), accepted + 1
        if on_iteration is not None:
            on_iteration(accepted, problem.rmse(x.reshape(shape)))
    return Refinement(x.reshape(shape), problem.rmse(x.reshape(shape)), accepted, converged)


@dataclass(frozen=True)
class NormalEquations:
    """J'WJ, J'W e and e'We of the free run over a data set."""

    information: FloatArray
    gradient: FloatArray
    squared_error: float
    weight: float


class _Problem:
    """The data of one refinement; validity functions are computed once."""

    def __init__(self, order: int, partition: Partition, data: Dataset, weights: FloatArray | None) -> None:
        self.order = order
        self._data = data
        self._validity = partition.validity(data.z)
        weight = np.ones(len(data)) if weights is None else weights.copy()
        self._is_start = initial_samples(len(data), data.starts, order)
        weight[np.isnan(data.y) | (self._is_start > 0)] = 0.0
        self._weight = weight
        self._target = np.where(np.isnan(data.y), 0.0, data.y)

    def residual(self, theta: FloatArray) -> FloatArray:
        return self._target - free_run(theta, self.order, self._validity, self._data)

    def cost(self, theta: FloatArray) -> float:
        return float(self._weight @ self.residual(theta) ** 2)

    def rmse(self, theta: FloatArray) -> float:
        return float(np.sqrt(self.cost(theta) / max(self._weight.sum(), 1e-12)))

    def normal_equations(self, theta: FloatArray) -> NormalEquations:
        a, f = blend(theta, self.order, self._validity, self._data)
        y_sim = run_recursion(a, f, self._data.y, self._data.starts)
        size = theta.size
        information, gradient = np.zeros((size, size)), np.zeros(size)
        carry = np.zeros((max(self.order, 1), size))
        block = np.empty((_BLOCK, size))
        error = self._target - y_sim
        for first in range(0, len(self._data), _BLOCK):
            rows = block[: min(_BLOCK, len(self._data) - first)]
            sensitivity_block(first, self._validity, self._data.u, y_sim, a, self._is_start, carry, rows)
            # One array times itself is a symmetric product, which takes half the time of a general one.
            root = np.sqrt(self._weight[first : first + len(rows)])
            rows *= root[:, None]
            information += rows.T @ rows
            gradient += rows.T @ (root * error[first : first + len(rows)])
        return NormalEquations(information, gradient, float(self._weight @ error**2), float(self._weight.sum()))


def normal_equations(
    theta: FloatArray, order: int, partition: Partition, data: Dataset, weights: FloatArray | None = None
) -> NormalEquations:
    """Information, gradient and squared error of the free run at given parameters (normalised units)."""
    with threadpool_limits(1, user_api="blas"):
        return _Problem(order, partition, data, weights).normal_equations(theta)


def stabilised(theta: FloatArray, order: int) -> FloatArray:
    """Pull the poles of each local model inside the unit circle.

    For n = 1 the blend of stable models is then stable for any input; for n = 2 real, positive poles are kept, whose
    coefficients form a convex set.
    """
    out = theta.copy()
    if order == 1:
        out[:, 0] = np.clip(out[:, 0], 0.0, _POLE_LIMIT)
    elif order == 2:
        for i in range(len(out)):
            poles = np.roots([1.0, -out[i, 0], -out[i, 1]])
            if np.abs(poles.imag).max() > 1e-9 or poles.real.max() > _POLE_LIMIT or poles.real.min() < -0.5:
                real = np.clip(poles.real, -0.5, _POLE_LIMIT)
                out[i, 0], out[i, 1] = real.sum(), -real.prod()
    return out
