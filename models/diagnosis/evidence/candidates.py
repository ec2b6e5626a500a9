"""Every effect tried alone on the error of the diagnosed runs, against what the training runs say."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.evidence.evidence import Evidence, Solution
from models.diagnosis.evidence.memory import Memory
from models.diagnosis.reference.samples import Samples
from models.effects import Effect
from models.effects.effect import Lean

_GRID = np.array([-1.0, -0.6, -0.3, -0.12, -0.04, 0.04, 0.12, 0.3, 0.6, 1.0])
_NEWTON_STEPS = 4
# Samples on which the grid is searched; the steps from the best of it look at all.
_GRID_SAMPLES = 1_500


# Compared by identity: two candidates are never the same one by their numbers.
@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect with what it explains.

    Attributes
    ----------
    effect : tried
    size : number of its regressors
    solution : what they explain
    contribution_V : (n,) its part of the voltage
    columns, target_V : (n, k), (n,) the linear problem that it was at last
    value, variance : of the parameter where it was simulated again, for a noise of 1 V^2
    """

    effect: Effect
    size: int
    solution: Solution
    contribution_V: FloatArray
    columns: FloatArray
    target_V: FloatArray
    value: float | None = None
    variance: float | None = None


@dataclass(frozen=True)
class Comparison:
    """Samples of the diagnosed runs against the training runs, and the effects that both can show.

    Attributes
    ----------
    runs : samples
    effects : in the order of their columns
    columns : (n, k) of each effect for the diagnosed runs
    evidence : of the diagnosed runs, where the model has been given what the training runs say of every effect
    own_mse : mean squared error that remains in the training runs, V^2
    noise_mse : of the measurement alone, V^2
    bias_allowance : how much of the own systematic error another record may show once more without anything being new
    """

    runs: Samples
    effects: tuple[Effect, ...]
    columns: dict[str, FloatArray]
    evidence: Evidence
    own_mse: float
    noise_mse: float
    bias_allowance: float = 1.0


def compare_samples(memory: Memory, runs: Samples, effects: list[Effect]) -> Comparison:
    """Give the model what the training runs say of every effect, so that only what is new remains.

    The change of an effect is the difference of its estimates from the two samples; what the model leaves unexplained
    in both alike cancels.

    Parameters
    ----------
    memory : of the training runs
    runs : samples of the diagnosed runs
    effects : some of those that the training runs show, in the same order
    """
    columns = {effect.name: runs.regressors(effect) for effect in effects}
    both = np.hstack([runs.own_regressors(memory.reference), *columns.values()])
    part = memory.part(effects)
    error = runs.error_V - both @ memory.moved(part)
    evidence = Evidence(error, both, memory.information[np.ix_(part, part)], runs.blocks)
    return Comparison(runs, tuple(effects), columns, evidence, memory.own_mse, memory.noise_mse)


def try_effect(comparison: Comparison, effect: Effect) -> Candidate:
    """Try one effect."""
    x = comparison.columns[effect.name]
    if effect.shift is not None and x.shape[1] == 1:
        return simulate_again(comparison, effect)
    found = comparison.evidence.solve(x)
    return Candidate(effect, x.shape[1], found, x @ found.coefficients, x, comparison.evidence.error_V)


def beside(comparison: Comparison, candidate: Candidate, before: Comparison) -> Candidate:
    """A candidate of one comparison in a wider one, linear about the same value.

    Parameters
    ----------
    comparison : whose error lacks what another effect stands for
    candidate : tried in `before`
    before : the comparison without the other effect
    """
    fixed_V = before.evidence.error_V - candidate.target_V
    target_V = comparison.evidence.error_V - fixed_V
    found = comparison.evidence.solve(candidate.columns, target_V)
    contribution_V = fixed_V + candidate.columns @ found.coefficients
    if candidate.value is None:
        return replace(candidate, solution=found, contribution_V=contribution_V, target_V=target_V)
    variance = float(found.covariance[0, 0])
    return replace(
        candidate,
        solution=found,
        contribution_V=contribution_V,
        target_V=target_V,
        value=float(found.coefficients[0]),
        variance=variance,
    )


def noise_V2(comparison: Comparison, candidate: Candidate) -> float:
    """Variance of the remaining error as estimates feel it: neighbouring errors hang together."""
    left = comparison.evidence.error_V - candidate.contribution_V
    left = left - comparison.evidence.absorbed(left)
    count = np.bincount(comparison.evidence.blocks)
    sums = np.bincount(comparison.evidence.blocks, weights=left)
    together = float(np.mean(sums**2 / np.maximum(count, 1)))
    return max(together, float(np.mean(left**2)))


@dataclass(frozen=True)
class LeanTrial:
    """The smallest form of an effect.

    Attributes
    ----------
    shape : best one of its grid
    columns : number of linear ones that are used
    size : parameters
    cost : remaining error, V^2
    """

    shape: float
    columns: int
    size: int
    cost: float


def try_lean(comparison: Comparison, effect: Effect, price: float = 0.0) -> LeanTrial:
    """Try the smallest form of an effect over its shapes, with its first column alone and with all of them.

    Parameters
    ----------
    comparison : samples
    effect : one that has such a form
    price : what a further column must explain, V^2
    """
    if effect.lean is None:
        raise ValueError(f"{effect.name} has no smaller form")
    shapes = effect.lean.shapes(comparison.runs.views[0])
    free = 1 if len(shapes) > 1 else 0
    trials = []
    for shape in shapes:
        x = lean_columns(comparison, effect.lean, shape)
        for used in {1, x.shape[1]}:
            trials.append(LeanTrial(shape, used, used + free, comparison.evidence.least_cost(x[:, :used])))
    return min(trials, key=lambda trial: trial.cost + price * trial.size)


def lean_columns(comparison: Comparison, lean: Lean, shape: float) -> FloatArray:
    """(n, j) columns of the smallest form of an effect."""
    return np.vstack([lean.columns(view, shape) for view in comparison.runs.views])


def simulate_again(comparison: Comparison, effect: Effect, start: float | None = None) -> Candidate:
    """Estimate the one parameter of an effect: Gauss-Newton from `start`, or else from the best of a grid."""
    evidence, runs, shift = comparison.evidence, comparison.runs, effect.shift
    assert shift is not None
    first = runs.views[0]
    low, high = shift.limits(first)
    step = shift.step(first)
    value = start if start is not None else _best_of_grid(comparison, effect, low, high) if shift.searched else 0.0
    for _ in range(_NEWTON_STEPS):
        at, x = _linearised(runs, effect, value, step)
        found = evidence.solve(x, evidence.error_V - at + x[:, 0] * value)
        moved = float(np.clip(found.coefficients[0], low, high))
        settled = abs(moved - value) < 0.01 * step
        value = moved
        if settled:
            break
    at, x = _linearised(runs, effect, value, step)
    target = evidence.error_V - at + x[:, 0] * value
    found = evidence.solve(x, target)
    contribution = at + x[:, 1:] @ found.coefficients[1:]
    return Candidate(effect, 1, found, contribution, x, target, value, float(found.covariance[0, 0]))


def _best_of_grid(comparison: Comparison, effect: Effect, low: float, high: float) -> float:
    every = max(1, len(comparison.runs.blocks) // _GRID_SAMPLES)
    chosen = np.arange(len(comparison.runs.blocks)) % every == 0
    runs, evidence = comparison.runs.kept(chosen), comparison.evidence.kept(chosen)

    def left(value: float) -> float:
        moved = runs.shifted(effect, value) if value else 0.0
        return evidence.solve(runs.beyond(effect, value), evidence.error_V - moved).cost

    return min([0.0, *(np.where(_GRID < 0, -low, high) * _GRID).tolist()], key=left)


def _linearised(runs: Samples, effect: Effect, value: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Change of voltage (n,), and (n, k) its derivative beside what is free beyond the model's range of SoC."""
    at = runs.shifted(effect, value) if value else np.zeros(len(runs.blocks))
    slope = (runs.shifted(effect, value + step) - at) / step
    return at, np.column_stack([slope, runs.beyond(effect, value)])
