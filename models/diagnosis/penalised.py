"""Least squares with quadratic penalties whose strengths are chosen on held-out blocks in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.timeseries import FloatArray

_BLOCKS, _FOLDS = 10, 5
_START: tuple[float, ...] = (1e-6, 1e-5, 1e-6)
_LIMITS = (1e-11, 1e2)
_FACTORS = (0.1, 10.0)
_WORTH = 0.999
_PASSES = 2
_RIDGE = 1e-12


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
    strengths : of the penalties; None: chosen on held-out blocks
    """
    sums = _sums(x, y)
    if strengths is None:
        strengths, held_out = _chosen(sums, forms)
    else:
        held_out = _held_out(sums, _weighted(forms, strengths))
    n = int(sums.count.sum())
    penalty = _weighted(forms, strengths) * n
    total = sums.xx.sum(axis=0)
    right = sums.xy.sum(axis=0)
    b = np.linalg.solve(total + penalty, right)
    own = max(float(sums.yy.sum() - 2.0 * b @ right + b @ total @ b), 0.0) / n
    return PenalisedFit(b, penalty, own, held_out, n, strengths)


def _sums(x: list[FloatArray], y: list[FloatArray]) -> _Sums:
    """Moments of blocks in time; several runs share the blocks."""
    per_run = max(1, _BLOCKS // len(x))
    xx, xy, yy, count = [], [], [], []
    for regressors, values in zip(x, y, strict=True):
        for rows in np.array_split(np.arange(len(values)), per_run):
            part, value = regressors[rows], values[rows]
            xx.append(part.T @ part)
            xy.append(part.T @ value)
            yy.append(value @ value)
            count.append(len(rows))
    return _Sums(np.array(xx), np.array(xy), np.array(yy), np.array(count, dtype=np.float64))


def _chosen(sums: _Sums, forms: list[FloatArray]) -> tuple[tuple[float, ...], float]:
    """Move one strength after the other by powers of ten while the held-out error falls.

    From weak ones: among nearly equal errors the weaker penalty resolves more, and a diagnosis lives on that.
    """
    strengths = _START
    best = _held_out(sums, _weighted(forms, strengths))
    for _ in range(_PASSES):
        for i in range(len(strengths)):
            for factor in _FACTORS:
                while _LIMITS[0] < strengths[i] * factor < _LIMITS[1]:
                    trial = (*strengths[:i], strengths[i] * factor, *strengths[i + 1 :])
                    error = _held_out(sums, _weighted(forms, trial))
                    if not error < _WORTH * best:
                        break
                    best, strengths = error, trial
    return strengths, best


def _weighted(forms: list[FloatArray], strengths: tuple[float, ...]) -> FloatArray:
    total = np.sum([s * form for s, form in zip(strengths, forms, strict=True)], axis=0)
    return total + _RIDGE * np.eye(len(total))


def _held_out(sums: _Sums, penalty: FloatArray) -> float:
    groups = np.arange(len(sums.count))
    whole_xx, whole_xy = sums.xx.sum(axis=0), sums.xy.sum(axis=0)
    total = 0.0
    for fold in range(min(_FOLDS, len(groups))):
        held = groups % _FOLDS == fold
        xx, xy, kept = sums.xx[held].sum(axis=0), sums.xy[held].sum(axis=0), sums.count[~held].sum()
        b = np.linalg.solve(whole_xx - xx + penalty * kept, whole_xy - xy)
        total += max(float(sums.yy[held].sum() - 2.0 * b @ xy + b @ xx @ b), 0.0)
    return total / float(sums.count.sum())
