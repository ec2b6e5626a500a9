"""Strengths of quadratic penalties, chosen on held-out groups of samples by Newton's method.

The error on a held-out group is an explicit function of the strengths: with A = X'X + sum_i s_i P_i of the other groups
and b = A^-1 X'y, db / d ln s_i = -A^-1 s_i P_i b, and so on for the second derivatives. All of them cost a few solves
with the factor that the error itself needs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import get_lapack_funcs

from models.data.timeseries import FloatArray
from models.network.folds import folds

# Keeps directions that no sample excites solvable; far below any information in the data.
_RIDGE = 1e-10
# Range, in powers of ten, of the strengths relative to the mean squared output, and where the search may begin.
_RANGE = (-10.0, 1.0)
_FIRST_LEVELS = (-8.0, -6.0, -4.0, -2.0, 0.0)
# Trust region in powers of ten: at first, and where the search gives up.
_RADIUS = 1.5
_SMALLEST_RADIUS = 0.1
# The search ends where the held-out error is not expected to fall by more than this share.
_WORTH = 3e-3
# It also ends where so many steps of the present kind would not make the error as small as asked for.
_HOPE = 4.0
_MOST_STEPS = 12
_SMALLEST_CURVATURE = 1e-3
# A squared error below this share of the squared signal is rounding.
_ROUNDING = 1e-14
_LN_10 = float(np.log(10.0))
# Without the checks of `cho_factor`, which take as long as the factor of a small matrix.
_POTRF, _POTRS = get_lapack_funcs(("potrf", "potrs"), (np.zeros(0),))


@dataclass(frozen=True)
class HeldOutError:
    """Mean squared error on held-out samples and the derivatives of its logarithm by the strengths' powers of ten."""

    mse: float
    gradient: FloatArray
    hessian: FloatArray


@dataclass(frozen=True)
class StrengthJudge:
    """Held-out error of any strengths; sums over all groups and over each fold are made once.

    Attributes
    ----------
    forms : (n, P, P) penalties
    aims : (n, P) each penalty times the parameters at which it is least
    folds : what each fold holds out and what it keeps
    """

    forms: FloatArray
    aims: FloatArray
    folds: list[_Fold]

    @classmethod
    def of(
        cls,
        xx: FloatArray,
        xy: FloatArray,
        yy: FloatArray,
        count: FloatArray,
        forms: list[FloatArray],
        centres: list[FloatArray] | None = None,
    ) -> StrengthJudge:
        """Sum over groups.

        Parameters
        ----------
        xx, xy, yy, count : (G, P, P), (G, P), (G,), (G,)
        forms : (P, P) penalties
        centres : (P,) parameters at which each penalty is least; 0 by default
        """
        every_xx, every_xy, every_count = xx.sum(axis=0), xy.sum(axis=0), float(count.sum())
        made = []
        for f in folds(len(count)):
            held_xx, held_xy, held = xx[f].sum(axis=0), xy[f].sum(axis=0), float(count[f].sum())
            kept = (every_xx - held_xx, every_xy - held_xy, every_count - held)
            made.append(_Fold(held_xx, held_xy, float(yy[f].sum()), held, *kept))
        aims = np.zeros((len(forms), len(every_xy)))
        for i, centre in enumerate(centres or []):
            aims[i] = forms[i] @ centre
        return cls(np.array(forms), aims, made)

    def fitted(self, log_strengths: FloatArray) -> list[FloatArray]:
        """(P,) parameters of each fold, without what it holds out."""
        weight = 10.0**log_strengths
        penalty, aim = np.tensordot(weight, self.forms, axes=1), weight @ self.aims
        return [
            Factored.of(fold.kept_xx + fold.kept_count * penalty).solve(fold.kept_xy + fold.kept_count * aim)
            for fold in self.folds
        ]

    def error(self, log_strengths: FloatArray) -> HeldOutError:
        """Error of given powers of ten."""
        n, weight = len(self.forms), 10.0**log_strengths
        weighted, aims = weight[:, None, None] * self.forms, weight[:, None] * self.aims
        penalty = weighted.sum(axis=0)
        factors = [Factored.of(fold.kept_xx + fold.kept_count * penalty) for fold in self.folds]
        right = [fold.kept_xy + fold.kept_count * aims.sum(axis=0) for fold in self.folds]
        b = [factor.solve(each) for factor, each in zip(factors, right, strict=True)]
        off = [fold.xx @ each - fold.xy for each, fold in zip(b, self.folds, strict=True)]
        back = [factor.solve(each) for factor, each in zip(factors, off, strict=True)]
        # All folds at once: (P, folds, n) of the form times b, and times A^-1 (X'X b - X'y).
        pushed, pulled = (np.stack([form @ np.stack(v, axis=1) for form in weighted], axis=2) for v in (b, back))
        total, gradient, hessian = 0.0, np.zeros(n), np.zeros((n, n))
        for i, (factor, fold) in enumerate(zip(factors, self.folds, strict=True)):
            push = fold.kept_count * (pushed[:, i] - aims.T)
            moved = -factor.solve(push)
            bent = fold.kept_count * (pulled[:, i].T @ moved)
            total += float(fold.yy + b[i] @ (off[i] - fold.xy))
            gradient += 2.0 * (off[i] @ moved)
            hessian += 2.0 * (moved.T @ (fold.xx @ moved)) - 2.0 * (bent + bent.T) - 2.0 * np.diag(back[i] @ push)
        # Runs without any noise can be met to the last digit; what is left is rounding.
        total = max(total, _ROUNDING * sum(fold.yy for fold in self.folds), 1e-300)
        slope = gradient / total
        bend = hessian / total - np.outer(slope, slope)
        return HeldOutError(total / max(sum(f.count for f in self.folds), 1.0), _LN_10 * slope, _LN_10**2 * bend)

    def best(self, start: tuple[float, ...] | None, hopeless_mse: float = np.inf) -> tuple[FloatArray, float]:
        """Powers of ten near `start`, or near the best of a few equal ones, and the mean squared error there.

        The search ends early where the error is not expected to fall below `hopeless_mse`.
        """
        low, high = _RANGE
        first = [np.full(len(self.forms), v) for v in _FIRST_LEVELS] if start is None else [np.clip(start, low, high)]
        tried = [(self.error(level), level) for level in first]
        now, at = min(tried, key=lambda pair: pair[0].mse)
        radius = _RADIUS
        for _ in range(_MOST_STEPS):
            step = _step(now, at, radius)
            expected = -float(now.gradient @ step + 0.5 * step @ now.hessian @ step)
            if expected < _WORTH or now.mse * np.exp(-_HOPE * expected) > hopeless_mse:
                break
            found = self.error(at + step)
            gained = float(np.log(now.mse / found.mse))
            if gained <= 0.0:
                radius /= 3.0
                if radius < _SMALLEST_RADIUS:
                    break
                continue
            radius = min(2.0 * radius, 2.0 * _RADIUS) if gained > 0.5 * expected else radius
            now, at = found, at + step
        return at, now.mse


@dataclass(frozen=True)
class _Fold:
    """Sums over the groups that a fold holds out, and over those that it keeps."""

    xx: FloatArray
    xy: FloatArray
    yy: float
    count: float
    kept_xx: FloatArray
    kept_xy: FloatArray
    kept_count: float


def _step(now: HeldOutError, at: FloatArray, radius: float) -> FloatArray:
    """Newton's step within the trust region; directions in which the error bends down are walked downhill."""
    low, high = _RANGE
    stuck = ((at <= low) & (now.gradient > 0.0)) | ((at >= high) & (now.gradient < 0.0))
    free = np.flatnonzero(~stuck)
    step = np.zeros(len(at))
    if len(free):
        values, vectors = np.linalg.eigh(now.hessian[np.ix_(free, free)])
        curvature = np.maximum(np.abs(values), _SMALLEST_CURVATURE)
        step[free] = -vectors @ ((vectors.T @ now.gradient[free]) / curvature)
    step *= min(1.0, radius / max(float(np.abs(step).max()), 1e-300))
    return np.clip(at + step, low, high) - at


@dataclass(frozen=True)
class Factored:
    """A symmetric matrix with a little ridge, factored; or its pseudo-inverse where it is singular all the same."""

    matrix: FloatArray
    is_cholesky: bool

    @classmethod
    def of(cls, information: FloatArray) -> Factored:
        """Factor `information` (P, P)."""
        size = len(information)
        # Symmetric, so that the transposed copy, whose order LAPACK wants, is the same matrix.
        regular = information.copy().T
        regular[np.diag_indices(size)] += _RIDGE * np.trace(information) / size
        root, failed = _POTRF(regular, lower=1, clean=0)
        return cls(np.linalg.pinv(regular, hermitian=True), False) if failed else cls(root, True)

    def solve(self, right: FloatArray) -> FloatArray:
        """Solve for (P,) or (P, n) right-hand sides."""
        return _POTRS(self.matrix, right, lower=1)[0] if self.is_cholesky else self.matrix @ right
