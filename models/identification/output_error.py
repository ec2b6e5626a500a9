"""Refinement on the free-run error: Gauss-Newton with exact sensitivities, regularised, kept stable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray
from models.identification.penalty_strengths import Factored, StrengthJudge
from models.network.partition import Partition
from models.network.penalty import Penalty
from models.network.recursion import blend, free_run, initial_samples, run_recursion, sensitivity_block
from models.network.regression import Dataset

_BLOCK = 2048
_POLE_LIMIT = 0.9995
# Powers of ten of the pull of poles towards their start, with which its choice begins; and of how many linearisations
# the strengths are chosen anew.
_FIRST_PULLS = (-1.0, -4.0, -7.0)
_CHOOSING = 5
# The choice begins from weak penalties too: those of shared poles are often far too strong, and held-out error can have
# a hollow there.
_WEAK = -8.0
# Shares of a step that are tried until the cost falls.
_SHARES = (1.0, 0.5, 0.2, 0.05, 0.01)


@dataclass(frozen=True)
class Refinement:
    """Result of a refinement.

    Attributes
    ----------
    theta : (M, p) refined parameters
    without : (M, p) for each fold, refined parameters that it had no part in
    log_strengths : powers of ten of the penalties; the last is that of the pull of the poles towards their start
    penalties : what was added to the information
    rmse : free-run RMSE on the refined data, normalised units
    iterations : accepted steps
    converged : whether the last step was small rather than the budget spent
    """

    theta: FloatArray
    without: list[FloatArray]
    log_strengths: tuple[float, ...]
    penalties: list[Penalty]
    rmse: float
    iterations: int
    converged: bool


@dataclass(frozen=True)
class HeldOutChoice:
    """Penalties whose strengths held-out samples choose.

    Attributes
    ----------
    forms : (M q, M q) quadratic penalties on the input parameters; one that holds the poles at their start is added
    fold : (N,) which fold holds a sample out
    log_strengths : powers of ten with which the search for those of `forms` begins
    """

    forms: list[FloatArray]
    fold: np.ndarray
    log_strengths: tuple[float, ...]


def refine(
    theta: FloatArray,
    order: int,
    partition: Partition,
    data: Dataset,
    chosen_by: HeldOutChoice,
    max_iterations: int = 20,
    on_iteration: Callable[[int, float], None] | None = None,
) -> Refinement:
    """Minimise the squared free-run error with penalties whose strengths held-out samples choose.

    At each linearisation the error of any strengths on any fold is explicit, as in a linear fit, so that penalties
    which served shared poles are not kept where they would bend the freed ones.

    Parameters
    ----------
    theta : (M, p) start values
    order : output order n
    partition : validity functions' boxes
    data : training samples; missing voltages do not count
    chosen_by : the penalties, and the folds that choose their strengths
    max_iterations : budget of steps
    on_iteration : called with the number of accepted steps and the RMSE

    Returns
    -------
    Refinement
        Never worse than the start on the penalised cost of the last strengths.
    """
    with threadpool_limits(1, user_api="blas"):
        problem = _Problem(order, partition, data)
        start = stabilised(theta, order)
        held = [*(on_inputs(form, theta.shape, order) for form in chosen_by.forms), _of_poles(start, order)]
        return _iterate(problem, start, replace(chosen_by, forms=held), max_iterations, on_iteration)


def _of_poles(theta: FloatArray, order: int) -> FloatArray:
    """Penalty on output coefficients, in terms of the static voltage that they change."""
    gain = 1.0 / np.maximum(1.0 - theta[:, :order].sum(axis=1), 1.0 - _POLE_LIMIT)
    each = np.zeros(theta.shape)
    each[:, :order] = gain[:, None] ** 2
    return np.diag(each.ravel())


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
    chosen_by: HeldOutChoice,
    max_iterations: int,
    on_iteration: Callable[[int, float], None] | None,
) -> Refinement:
    shape, x0, forms, fold = start.shape, start.ravel(), chosen_by.forms, chosen_by.fold
    centres = [*(np.zeros(len(x0)) for _ in forms[1:]), x0]
    weak = np.full(len(forms), _WEAK)
    tried = [weak, *(np.array([*chosen_by.log_strengths, pull]) for pull in _FIRST_PULLS)]
    x, accepted, converged, strengths = x0, 0, False, weak
    while True:
        sums = problem.sums(x.reshape(shape), fold)
        judge = StrengthJudge.of(*sums, forms, [centre - x for centre in centres])
        if accepted <= _CHOOSING:
            begin = tried if accepted == 0 else [strengths, weak]
            strengths = min((judge.best(tuple(each)) for each in begin), key=lambda pair: pair[1])[0]
        weight = float(sums[3].sum()) * 10.0**strengths
        penalty = np.tensordot(weight, judge.forms, axes=1)
        if converged or accepted >= max_iterations:
            break

        def penalised(at: FloatArray, weight: FloatArray = weight) -> float:
            apart = sum(
                w * float((at - c) @ form @ (at - c)) for w, form, c in zip(weight, forms, centres, strict=True)
            )
            return problem.cost(at.reshape(shape)) + apart

        gradient = sums[1].sum(axis=0) + weight @ judge.aims
        step = Factored.of(sums[0].sum(axis=0) + penalty).solve(gradient)
        cost = penalised(x)
        for share in _SHARES:
            candidate = stabilised((x + share * step).reshape(shape), problem.order).ravel()
            candidate_cost = penalised(candidate)
            if np.isfinite(candidate_cost) and candidate_cost < cost:
                break
        else:
            converged = True
            continue
        converged = cost - candidate_cost < 1e-4 * cost
        x, accepted = candidate, accepted + 1
        if on_iteration is not None:
            on_iteration(accepted, problem.rmse(x.reshape(shape)))
    without = [stabilised((x + step).reshape(shape), problem.order) for step in judge.fitted(strengths)]
    theta = x.reshape(shape)
    used = [Penalty(w * form, x - centre) for w, form, centre in zip(weight, forms, centres, strict=True)]
    return Refinement(theta, without, tuple(strengths.tolist()), used, problem.rmse(theta), accepted, converged)


@dataclass(frozen=True)
class NormalEquations:
    """J'WJ, J'W e and e'We of the free run over a data set."""

    information: FloatArray
    gradient: FloatArray
    squared_error: float
    weight: float


class _Problem:
    """The data of one refinement; validity functions are computed once."""

    def __init__(self, order: int, partition: Partition, data: Dataset, weights: FloatArray | None = None) -> None:
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

    def sums(self, theta: FloatArray, fold: np.ndarray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """J'WJ (F, P, P), J'We (F, P), e'We and weight (F,) of each fold."""
        a, f = blend(theta, self.order, self._validity, self._data)
        y_sim = run_recursion(a, f, self._data.y, self._data.starts)
        size, n_folds = theta.size, int(fold.max()) + 1
        xx, xy = np.zeros((n_folds, size, size)), np.zeros((n_folds, size))
        carry, block = np.zeros((max(self.order, 1), size)), np.empty((_BLOCK, size))
        error = self._target - y_sim
        cuts = np.flatnonzero(np.diff(fold)) + 1
        for first, end in zip([0, *cuts], [*cuts, len(fold)], strict=True):
            for begin in range(first, end, _BLOCK):
                part = slice(begin, min(begin + _BLOCK, end))
                rows = block[: part.stop - begin]
                sensitivity_block(begin, self._validity, self._data.u, y_sim, a, self._is_start, carry, rows)
                # One array times itself is a symmetric product, which takes half the time of a general one.
                root = np.sqrt(self._weight[part])
                rows *= root[:, None]
                xx[fold[first]] += rows.T @ rows
                xy[fold[first]] += rows.T @ (root * error[part])
        squared = np.asarray(np.bincount(fold, self._weight * error**2, n_folds), dtype=np.float64)
        weight = np.asarray(np.bincount(fold, self._weight, n_folds), dtype=np.float64)
        return xx, xy, squared, weight

    def normal_equations(self, theta: FloatArray) -> NormalEquations:
        xx, xy, squared, weight = self.sums(theta, np.zeros(len(self._data), dtype=np.int64))
        return NormalEquations(xx[0], xy[0], float(squared[0]), float(weight[0]))


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
