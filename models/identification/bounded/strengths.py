"""Strengths of the penalties of a bounded network, chosen by its error on held-out folds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from models.data.timeseries import FloatArray
from models.identification.bounded.box_least_squares import Solution, solve
from models.identification.bounded.problem import Sums

# Logarithms to base 10: bend of the curve, differences of gains, their size, slope with temperature.
START = (-2.0, -3.0, -5.0, -3.0)
_STEP = 1.0
# Weaker ones let gains at one state of charge have nothing to do with those at the next: what a cold run tells of the
# middle would tell nothing of the end. Held-out errors do not see that where no run was there in the cold.
_LOWEST, _HIGHEST = (-4.0, -3.0, -5.0, -3.0), 3.0
PASSES = 4
# Power of a fold's squared error in the error of a typical one. With 1, the mean square, a fold that had a knee to
# itself decides alone; with 0, the mean logarithm, it does not count for more than any other (Leaf modules 49.1 mV in
# place of 28.3); with a half the knee leaves 2.2 mV where 1.1 are had with a quarter.
_TYPICAL = 0.25


@dataclass
class HeldOut:
    """Held-out errors of one set of sums, each set of strengths solved once.

    Attributes
    ----------
    sums : the curve given by its increments
    """

    sums: Sums
    _known: dict[tuple[float, ...], FloatArray] = field(default_factory=dict)
    _side: dict[int, np.ndarray] = field(default_factory=dict)
    _worst: dict[int, float] = field(default_factory=dict)
    _others: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    _penalty: dict[tuple[float, ...], FloatArray] = field(default_factory=dict)

    def mse(self, logs: tuple[float, ...]) -> FloatArray:
        """(folds,) mean squared error in V^2 of each fold by a fit to the others."""
        if logs not in self._known:
            total = range(len(self.sums.count))
            self._known[logs] = np.array([self._of_fold(logs, f) if self.sums.count[f] > 0 else 0.0 for f in total])
        return self._known[logs]

    def mean_mse(self, logs: tuple[float, ...]) -> float:
        """Mean squared error in V^2 over all samples."""
        return float(self.mse(logs) @ self.sums.count / self.sums.count.sum())

    def best(self, start: tuple[float, ...] = START, passes: int = PASSES) -> tuple[float, ...]:
        """Strengths with the least held-out error, found one after the other in so many passes at most."""
        return _searched(start, passes, lambda trial, best: self._below(trial, self.mean_mse(best)))

    def typical_V(self, logs: tuple[float, ...]) -> float:
        """Error of a typical fold: squared mean over all samples of the root of their fold's RMS error in V."""
        count = self.sums.count
        return float(self.mse(logs) ** _TYPICAL @ count / count.sum()) ** (0.5 / _TYPICAL)

    def even(self, *starts: tuple[float, ...]) -> tuple[float, ...]:
        """Strengths with the least `typical_V`, searched from each start.

        Where one fold alone reached a knee, nothing tells of it without that fold. The error of going on to there is
        most of all squared error; strengths that take a fifth off it left four times the error everywhere else.
        """
        found = [_searched(start, PASSES, lambda a, b: self.typical_V(a) < self.typical_V(b)) for start in starts]
        return min(found, key=self.typical_V)

    def whole(self, logs: tuple[float, ...]) -> Solution:
        """The fit to all folds."""
        sums, count = self.sums, float(self.sums.count.sum())
        matrix = sums.xx.sum(axis=0) / count + penalty(sums, logs)
        return solve(matrix, sums.xy.sum(axis=0) / count, sums.layout.box, self._side.get(-1))

    def _below(self, logs: tuple[float, ...], limit: float) -> bool:
        """Whether the mean squared error is below a limit; folds are left out once their sum is past it."""
        if logs in self._known:
            return self.mean_mse(logs) < limit
        count = self.sums.count
        found, left = np.zeros(len(count)), limit * float(count.sum())
        # The fold that was worst last is most likely to say no.
        for fold in sorted(range(len(count)), key=lambda f: -self._worst.get(f, 0.0)):
            if count[fold] > 0.0:
                found[fold] = self._of_fold(logs, fold)
                left -= found[fold] * float(count[fold])
                self._worst[fold] = found[fold] * float(count[fold])
            if left <= 0.0:
                return False
        self._known[logs] = found
        return True

    def _of_fold(self, logs: tuple[float, ...], fold: int) -> float:
        x = self.without(logs, fold).x
        sums = self.sums
        squared = sums.yy[fold] - 2.0 * x @ sums.xy[fold] + x @ sums.xx[fold] @ x
        return float(max(squared, 0.0) / sums.count[fold])

    def without(self, logs: tuple[float, ...], fold: int) -> Solution:
        """The fit to all folds but one."""
        sums = self.sums
        if fold not in self._others:
            kept = np.arange(len(sums.count)) != fold
            count = float(sums.count[kept].sum())
            self._others[fold] = sums.xx[kept].sum(axis=0) / count, sums.xy[kept].sum(axis=0) / count
        if logs not in self._penalty:
            # All folds are asked for one set of strengths before the next.
            self._penalty = {logs: penalty(sums, logs)}
        information, right = self._others[fold]
        found = solve(information + self._penalty[logs], right, sums.layout.box, self._side.get(fold))
        self._side[fold] = found.side
        return found


def _searched(
    start: tuple[float, ...], passes: int, better: Callable[[tuple[float, ...], tuple[float, ...]], bool]
) -> tuple[float, ...]:
    """Strengths moved one after the other for as long as they get better."""
    best = start
    for _ in range(passes):
        before = best
        for place in range(len(best)):
            best = _along(best, place, better)
        if best == before:
            break
    return best


def _along(
    best: tuple[float, ...], place: int, better: Callable[[tuple[float, ...], tuple[float, ...]], bool]
) -> tuple[float, ...]:
    for sign in (_STEP, -_STEP):
        moved = False
        while True:
            trial = (*best[:place], best[place] + sign, *best[place + 1 :])
            if not _LOWEST[place] <= trial[place] <= _HIGHEST or not better(trial, best):
                break
            best, moved = trial, True
        if moved:
            break
    return best


def penalty(sums: Sums, logs: tuple[float, ...]) -> FloatArray:
    """(P, P) sum of the penalties with their strengths; those without one of their own count as they are."""
    weights = np.ones(len(sums.penalties))
    weights[: len(logs)] = 10.0 ** np.array(logs)
    return np.tensordot(weights, sums.penalties, axes=1)
