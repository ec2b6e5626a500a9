"""Many projected gradient ascents from random currents, and the best of what they reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.constraints.feasible import Demands, Feasible
from models.design.information.experiment import Evaluator, Experiment

Progress = Callable[[float, str], None]

# First step: the mean change of the samples, over half the current's range. The optimum has most samples at a limit, so
# it may be large.
_FIRST_STEP = 0.3
_GROW, _SHRINK = 2.0, 0.25
_SMALLEST_STEP = 1e-3
# Gain of the criterion per parameter below which a step no longer counts, and how many such steps end an ascent.
_SMALLEST_GAIN = 1e-4
_IDLE_STEPS = 2
# Random currents are held for up to this share of the experiment.
_LONGEST_HOLD = 0.1
# Every start climbs this many steps; then the best of them, this share, climb to the end.
_TRIAL_STEPS = 4
_FINALISTS = 0.15
# How often those renew the band of the predicted voltage on their way.
_RENEWALS = 3


class Objective(Protocol):
    """A function of a current, and its gradient at the current whose value was asked for last."""

    def value(self, current_A: FloatArray) -> float:
        """Value; larger is better."""
        ...

    def gradient(self) -> FloatArray:
        """(N,) derivative in 1/A."""
        ...


@dataclass(frozen=True)
class Optimum:
    """What the ascents found.

    Attributes
    ----------
    current_A : (N,) keeps every limit
    value : its criterion
    optimality : first-order gain of the criterion per parameter that a step of 1 % of the current's range towards the
        gradient, moved back into the limits, would still bring; 0 at a local optimum
    starts : criterion that each start reached, in the order of the starts
    finished : (n_starts,) whether it was followed to its local optimum; the others were behind after a few steps
    iterations : gradients computed, all starts together
    """

    current_A: FloatArray
    value: float
    optimality: float
    starts: FloatArray
    finished: np.ndarray
    iterations: int

    @property
    def spread(self) -> float:
        """Between the best and the worst local optimum that was reached."""
        return float(np.ptp(self.starts[self.finished]))


@dataclass(frozen=True)
class _Climb:
    """How far one ascent has come."""

    current_A: FloatArray
    value: float
    step_A: float
    idle: int = 0
    ended: bool = False


def optimise(
    experiment: Experiment,
    demands: Demands,
    n_samples: int,
    *,
    criterion: str | Objective = "D",
    n_starts: int = 40,
    max_iterations: int = 25,
    seed: int = 0,
    progress: Progress | None = None,
) -> Optimum:
    """Find the most informative current.

    Parameters
    ----------
    experiment : what is to be learnt, and from where
    demands : what the current has to keep
    n_samples : its length in sampling times of the network
    criterion : "A", "D" or "E", or what is made as large as possible instead
    n_starts : ascents from different random currents; local optima are real
    max_iterations : gradients of each ascent
    seed : of the starts; the same gives the same result, to the bit
    progress : called with a share 0..1 and a short text

    Returns
    -------
    Optimum

    Raises
    ------
    InfeasibleError
        No current keeps the limits.
    """
    if n_starts < 1 or max_iterations < 1:
        raise ModelError(f"{n_starts} starts of {max_iterations} iterations; at least one of each is needed")
    report = progress or (lambda share, text: None)
    with threadpool_limits(1, user_api="blas"):
        feasible = Feasible(experiment, demands, n_samples)
        evaluator = Evaluator(experiment, n_samples, criterion) if isinstance(criterion, str) else criterion
        search = _Search(evaluator, feasible, demands.limits.current_A, experiment.network.theta.size)
        climbs = _first_climbs(search, n_samples, n_starts, min(_TRIAL_STEPS, max_iterations), seed, report)
        finalists = _finish_best(search, climbs, max_iterations - _TRIAL_STEPS, report)
        # What the band of the voltage, taken at the end, leaves of them is not in their order.
        ends = [feasible.finish(climbs[number].current_A) for number in finalists]
        best = max(ends, key=evaluator.value)
        value = evaluator.value(best)
        return Optimum(
            current_A=best,
            value=value,
            optimality=search.optimality(best),
            starts=np.array([climb.value for climb in climbs]),
            finished=np.isin(np.arange(n_starts), finalists),
            iterations=search.iterations,
        )


def _first_climbs(
    search: _Search, n_samples: int, n_starts: int, n_steps: int, seed: int, report: Progress
) -> list[_Climb]:
    """Every start, a few steps up."""
    climbs = []
    for number in range(n_starts):
        first = search.start(n_samples, np.random.default_rng([seed, number]))
        climbs.append(search.climb(first, n_steps))
        report(0.7 * (number + 1) / n_starts, f"start {number + 1} of {n_starts}")
    return climbs


def _finish_best(search: _Search, climbs: list[_Climb], n_steps: int, report: Progress) -> np.ndarray:
    """Let the best climbs go on to the end, in their places; which ones those are.

    How far the voltage may be off depends on the current: from here on it is what it is at each climb's own.
    """
    ranking = np.argsort([-climb.value for climb in climbs], kind="stable")
    finalists = ranking[: max(1, round(_FINALISTS * len(climbs)))]
    for place, number in enumerate(finalists):
        for _ in range(_RENEWALS):
            climbs[number] = search.climb(search.renewed(climbs[number]), -(-n_steps // _RENEWALS))
        report(0.7 + 0.3 * (place + 1) / len(finalists), f"climbing the best, {place + 1} of {len(finalists)}")
    return finalists


class _Search:
    """One ascent after another on the same arrays."""

    def __init__(
        self, evaluator: Objective, feasible: Feasible, current_A: tuple[float, float], n_parameters: int
    ) -> None:
        self._evaluator, self._feasible = evaluator, feasible
        self._low_A, self._high_A = current_A
        self._half_A = 0.5 * (current_A[1] - current_A[0])
        self._n_parameters = n_parameters
        self.iterations = 0

    def start(self, n_samples: int, rng: np.random.Generator) -> _Climb:
        """Draw levels that are held for a time of their own: every start has other frequencies."""
        hold = int(np.exp(rng.uniform(0.0, np.log(max(_LONGEST_HOLD * n_samples, 1.0)))))
        levels = rng.uniform(self._low_A, self._high_A, -(-n_samples // hold))
        current = self._feasible.project(np.repeat(levels, hold)[:n_samples])
        return _Climb(current, self._evaluator.value(current), _FIRST_STEP * self._half_A)

    def renewed(self, at: _Climb) -> _Climb:
        """Where a climb stands with the voltage's band taken anew at its current."""
        if not self._feasible.renew(at.current_A):
            return at
        current = self._feasible.project(at.current_A)
        return _Climb(current, self._evaluator.value(current), max(at.step_A, _FIRST_STEP * self._half_A))

    def climb(self, at: _Climb, max_iterations: int) -> _Climb:
        """Go up for some steps, or until nothing is gained any more."""
        if not at.ended:
            # The gradient is that of the current whose value was asked for last.
            self._evaluator.value(at.current_A)
        for _ in range(max_iterations):
            if at.ended:
                break
            at = self._step(at)
        return at

    def _step(self, at: _Climb) -> _Climb:
        """Take one step whose length adapts; the held direction of the current is renewed with each trial."""
        gradient = self._evaluator.gradient()
        self.iterations += 1
        scale, step = float(np.abs(gradient).mean()), at.step_A
        while scale > 0.0 and step >= _SMALLEST_STEP * self._half_A:
            moved = self._feasible.project(at.current_A + (step / scale) * gradient)
            value = self._evaluator.value(moved)
            if value > at.value:
                idle = at.idle + 1 if value - at.value < _SMALLEST_GAIN * self._n_parameters else 0
                return _Climb(moved, value, _GROW * step, idle, idle >= _IDLE_STEPS)
            step *= _SHRINK
        return _Climb(at.current_A, at.value, step, at.idle, True)

    def optimality(self, current_A: FloatArray) -> float:
        """See `Optimum`."""
        self._evaluator.value(current_A)
        gradient = self._evaluator.gradient()
        largest = float(np.abs(gradient).max())
        if not largest > 0.0:
            return 0.0
        step = 0.02 * self._half_A / largest
        moved = self._feasible.project(current_A + step * gradient)
        return max(0.0, float(gradient @ (moved - current_A))) / self._n_parameters
