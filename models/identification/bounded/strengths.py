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
    """Held-out errors of one set of sums, each fold solved once with a set of strengths.

    Attributes
    ----------
    sums : what is fitted; the curve given by its increments
    judged : what the errors are of, with the same coefficients and folds; None: the same
    """

    sums: Sums
    judged: Sums | None = None
    _known: dict[tuple[float, ...], FloatArray] = field(default_factory=dict)
    _sides: dict[int, dict[tuple[float, ...], np.ndarray]] = field(default_factory=dict)
    _worst: dict[int, float] = field(default_factory=dict)
    _others: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    _penalty: dict[tuple[float, ...], FloatArray] = field(default_factory=dict)

    @property
    def count(self) -> FloatArray:
        """(folds,) samples that each error is of, or what they weigh."""
        return self._of.count

    @property
    def _of(self) -> Sums:
        return self.judged or self.sums

    def mse(self, logs: tuple[float, ...]) -> FloatArray:
        """(folds,) mean squared error in V^2 of each fold by a fit to the others."""
        return np.array([self._error(logs, fold) for fold in range(len(self.count))])

    def mean_mse(self, logs: tuple[float, ...]) -> float:
        """Mean squared error in V^2 over all samples."""
        return float(self.mse(logs) @ self.count / self.count.sum())

    def best(self, start: tuple[float, ...] = START, passes: int = PASSES) -> tuple[float, ...]:
        """Strengths with the least held-out error, found one after the other in so many passes at most."""
        return _searched(start, passes, lambda trial, best: self._below(trial, self.mean_mse(best), 1.0))

    def typical_V(self, logs: tuple[float, ...]) -> float:
        """Error of a typical fold: squared mean over all samples of the root of their fold's RMS error in V."""
        return self._typical(logs) ** (0.5 / _TYPICAL)

    def _typical(self, logs: tuple[float, ...]) -> float:
        return float(self.mse(logs) ** _TYPICAL @ self.count / self.count.sum())

    def even(self, *starts: tuple[float, ...]) -> tuple[float, ...]:
        """Strengths with the least `typical_V`, searched from each start.

        Where one fold alone reached a knee, nothing tells of it without that fold. The error of going on to there is
        most of all squared error; strengths that take a fifth off it left four times the error everywhere else.
        """

        def better(trial: tuple[float, ...], best: tuple[float, ...]) -> bool:
            return self._below(trial, self._typical(best), _TYPICAL)

        return min((_searched(start, PASSES, better) for start in starts), key=self.typical_V)

    def whole(self, logs: tuple[float, ...]) -> Solution:
        """The fit to all folds."""
        sums, count = self.sums, float(self.sums.count.sum())
        matrix = sums.xx.sum(axis=0) / count + penalty(sums, logs)
        return solve(matrix, sums.xy.sum(axis=0) / count, sums.layout.box)

    def _below(self, logs: tuple[float, ...], limit: float, power: float) -> bool:
        """Whether the mean of a power of the folds' squared errors is below a limit, asked for as long as it may be."""
        count, known = self.count, self._known_of(logs)
        left = limit * float(count.sum())
        # What is known costs nothing, and the fold that was worst last is most likely to say no.
        for fold in sorted(range(len(count)), key=lambda f: (np.isnan(known[f]), -self._worst.get(f, 0.0))):
            left -= self._error(logs, fold) ** power * float(count[fold])
            if left <= 0.0:
                return False
        return True

    def _error(self, logs: tuple[float, ...], fold: int) -> float:
        """Mean squared error in V^2 of a fold by a fit to the others; 0 where it has no samples."""
        known = self._known_of(logs)
        if np.isnan(known[fold]):
            known[fold] = self._of_fold(logs, fold)
            self._worst[fold] = known[fold] * float(self.count[fold])
        return float(known[fold])

    def _known_of(self, logs: tuple[float, ...]) -> FloatArray:
        """(folds,) errors that are known, NaN where they are not yet."""
        return self._known.setdefault(logs, np.where(self.count > 0.0, np.nan, 0.0))

    def _of_fold(self, logs: tuple[float, ...], fold: int) -> float:
        x = self.without(logs, fold).x
        of = self._of
        squared = of.yy[fold] - 2.0 * x @ of.xy[fold] + x @ of.xx[fold] @ x
        return float(max(squared, 0.0) / of.count[fold])

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
        sides = self._sides.setdefault(fold, {})
        near = min(sides, key=lambda known: sum(abs(a - b) for a, b in zip(known, logs, strict=True)), default=None)
        found = solve(information + self._penalty[logs], right, sums.layout.box, None if near is None else sides[near])
        sides[logs] = found.side
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
