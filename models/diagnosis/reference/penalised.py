"""Least squares with quadratic penalties whose strengths make the data most likely.

A record goes through a state of charge at one temperature, seldom at two. Held-out blocks that lie in between what was
measured say nothing of the rest, and weak penalties win that fail in the next record; held-out blocks that are long
ask a curve to be extrapolated, and stiff ones win that cannot follow a plateau. The likelihood with the coefficients
integrated out asks for no more than that they are as rough as the penalty says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.errors import NotIdentifiableError
from models.data.timeseries import FloatArray

# Every fifth short stretch is held out, so that what is left goes through the same states of charge.
_BLOCKS, _FOLDS = 100, 5
_START: tuple[float, ...] = (1e-6, 1e-5, 1e-6)
_LIMITS = (1e-11, 1e2)
_FACTORS = (0.1, 10.0)
# Samples that say as much as one independent one: the model's error hangs together in time.
_ALIKE = 5.0
_PASSES = 2
_RIDGE = 1e-12
_TINY = 1e-300


@dataclass(frozen=True)
class PenalisedFit:
    """A fit.

    Attributes
    ----------
    coefficients : (p,)
    penalty : (p, p) that was added to the information
    own_mse, held_out_mse : mean squared error on all samples and on held-out blocks
    n_samples : used
    strengths : of the penalties
    """

    coefficients: FloatArray
    penalty: FloatArray
    own_mse: float
    held_out_mse: float
    n_samples: int
    strengths: tuple[float, ...]


@dataclass(frozen=True)
class _Sums:
    """Moments of each fold."""

    xx: FloatArray
    xy: FloatArray
    yy: FloatArray
    count: FloatArray


def penalised_fit(
    x: list[FloatArray], y: list[FloatArray], forms: list[FloatArray], strengths: tuple[float, ...] | None = None
) -> PenalisedFit:
    """Fit y = x b with penalties.

    Parameters
    ----------
    x, y : (n, p) regressors and (n,) values of each run
    forms : (p, p) quadratic forms, as many as there are start values of strengths (three)
    strengths : of the penalties; None: the most likely ones
    """
    sums = _sums(x, y)
    if strengths is None:
        strengths = _chosen(sums, forms)
    held_out = _held_out(sums, _weighted(forms, strengths))
    n = int(sums.count.sum())
    penalty = _weighted(forms, strengths) * n
    total = sums.xx.sum(axis=0)
    right = sums.xy.sum(axis=0)
    b = _solved(total + penalty, right)
    own = max(float(sums.yy.sum() - 2.0 * b @ right + b @ total @ b), 0.0) / n
    return PenalisedFit(b, penalty, own, held_out, n, strengths)


def _sums(x: list[FloatArray], y: list[FloatArray]) -> _Sums:
    """Moments of the folds, each of many stretches of time; several runs share the stretches."""
    per_run = max(_FOLDS, _BLOCKS // len(x))
    fold = np.concatenate([np.arange(len(values)) * per_run // len(values) % _FOLDS for values in y])
    regressors, values = np.vstack(x), np.concatenate(y)
    xx, xy, yy, count = [], [], [], []
    for number in range(_FOLDS):
        part, value = regressors[fold == number], values[fold == number]
        xx.append(part.T @ part)
        xy.append(part.T @ value)
        yy.append(value @ value)
        count.append(len(value))
    return _Sums(np.array(xx), np.array(xy), np.array(yy), np.array(count, dtype=np.float64))


def _chosen(sums: _Sums, forms: list[FloatArray]) -> tuple[float, ...]:
    """Move one strength after the other by powers of ten while the data become more likely."""
    strengths = _START
    total = _Total(sums.xx.sum(axis=0), sums.xy.sum(axis=0), float(sums.yy.sum()), float(sums.count.sum()))
    best = total.log_likelihood(_weighted(forms, strengths))
    for _ in range(_PASSES):
        for i in range(len(strengths)):
            for factor in _FACTORS:
                while _LIMITS[0] < strengths[i] * factor < _LIMITS[1]:
                    trial = (*strengths[:i], strengths[i] * factor, *strengths[i + 1 :])
                    found = total.log_likelihood(_weighted(forms, trial))
                    if found <= best:
                        break
                    best, strengths = found, trial
    return strengths


@dataclass(frozen=True)
class _Total:
    """Moments of all samples."""

    xx: FloatArray
    xy: FloatArray
    yy: float
    count: float

    def log_likelihood(self, penalty: FloatArray) -> float:
        """Of the values, the coefficients integrated out, with the most likely variance of the noise (MacKay 1992)."""
        information = self.xx + penalty * self.count
        left = self.yy - float(_solved(information, self.xy) @ self.xy)
        grown = np.linalg.slogdet(information)[1] - np.linalg.slogdet(penalty * self.count)[1]
        return -0.5 * (self.count / _ALIKE * np.log(max(left, 1e-300)) + float(grown))


def _weighted(forms: list[FloatArray], strengths: tuple[float, ...]) -> FloatArray:
    total = np.sum([s * form for s, form in zip(strengths, forms, strict=True)], axis=0)
    return total + _RIDGE * np.eye(len(total))


def _held_out(sums: _Sums, penalty: FloatArray) -> float:
    whole_xx, whole_xy, whole = sums.xx.sum(axis=0), sums.xy.sum(axis=0), sums.count.sum()
    total = 0.0
    for xx, xy, yy, count in zip(sums.xx, sums.xy, sums.yy, sums.count, strict=True):
        b = _solved(whole_xx - xx + penalty * (whole - count), whole_xy - xy)
        total += max(float(yy - 2.0 * b @ xy + b @ xx @ b), 0.0)
    return total / float(whole)


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve for coefficients of very different sizes.

    Raises
    ------
    NotIdentifiableError
        Regressors or values are not finite, or some are nothing but a sum of others and no penalty holds them.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), _TINY))
    try:
        found = np.linalg.solve(matrix / np.outer(scale, scale), right / scale) / scale
    except np.linalg.LinAlgError:
        found = np.full(len(right), np.nan)
    if not np.isfinite(found).all():
        raise NotIdentifiableError(
            "diagnosis: these runs do not determine a model of the cell: look for outliers in current and voltage, "
            "for a temperature that is missing or wrong, or name runs with more steps of current"
        )
    return found
