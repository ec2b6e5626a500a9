"""How smooth tables should be, and how strongly: decided on samples that the fit does not see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.baselines.normal_equations import Sums, Term, offsets, solve
from models.data.timeseries import FloatArray

# Powers of ten: volt squared per unit of squared curvature (open-circuit voltage) or slope (all else).
_RANGE = (-13.0, 2.0)
_STEPS = (1.5, 0.5)
_START = (-8.0, -4.0, -4.0, -4.0)
# Temperature differences count in this unit, so that they weigh like differences over the whole range of charge.
_TEMPERATURE_UNIT_K = 30.0


@dataclass(frozen=True)
class Smoothing:
    """A penalty with its strengths.

    Attributes
    ----------
    log_strengths : powers of ten, one for each form
    penalty : (P, P) for one sample; to be multiplied with the number of samples
    held_out_mse : mean squared error in V^2 on samples that the fit did not see
    """

    log_strengths: tuple[float, ...]
    penalty: FloatArray
    held_out_mse: float


def forms(terms: list[Term]) -> list[FloatArray]:
    """Quadratic forms of what should be small, each to be weighted on its own.

    Curvature of the open-circuit voltage over charge, its change over temperature, and the change of all other tables
    over charge and over temperature. So the open-circuit voltage goes on as a straight line where no data are, and a
    resistance at its last value.
    """
    first = offsets(terms)
    out: list[FloatArray] = [np.zeros((first[-1], first[-1])) for _ in range(4)]
    for start, term in zip(first[:-1], terms, strict=True):
        scale = max(float(np.sqrt(np.mean(term.signal**2))), 1e-6)
        column = start + np.arange(term.size).reshape(term.soc.size, term.temperature.size)
        spacing, kelvin = np.diff(term.soc.knots), np.diff(term.temperature.knots) / _TEMPERATURE_UNIT_K
        if term.is_ocv:
            rows = np.array([1.0, -2.0, 1.0]) / spacing[1:, None] ** 1.5
            _add(out[0], column[:-2], column[1:-1], column[2:], rows=rows)
        else:
            rows = np.array([-1.0, 1.0]) * scale / np.sqrt(spacing[:, None])
            _add(out[2], column[:-1], column[1:], rows=rows)
        rows = np.array([-1.0, 1.0]) * scale / np.sqrt(kelvin[:, None] * term.soc.size)
        _add(out[1 if term.is_ocv else 3], column.T[:-1], column.T[1:], rows=rows)
    return out


def weighted(parts: list[FloatArray], log_strengths: tuple[float, ...]) -> FloatArray:
    """Sum of the forms with their strengths."""
    return np.sum([10.0**s * part for s, part in zip(log_strengths, parts, strict=True)], axis=0)


def default(terms: list[Term], sums: Sums) -> Smoothing:
    """Smoothing of middle strength, to begin with."""
    penalty = weighted(forms(terms), _START)
    return Smoothing(_START, penalty, held_out_mse(sums, penalty))


def choose(parts: list[FloatArray], sums: Sums, start: tuple[float, ...] | None = None) -> Smoothing:
    """Strengths with the least held-out error, one after the other, in coarse and then in fine steps."""
    strengths = start or _START
    best = held_out_mse(sums, weighted(parts, strengths))
    for step in _STEPS:
        for i in [i for i, part in enumerate(parts) if part.any()]:
            for signed in (step, -step):
                while _RANGE[0] <= strengths[i] + signed <= _RANGE[1]:
                    trial = (*strengths[:i], strengths[i] + signed, *strengths[i + 1 :])
                    error = held_out_mse(sums, weighted(parts, trial))
                    if not error < best * (1.0 - 1e-4):
                        break
                    best, strengths = error, trial
    return Smoothing(strengths, weighted(parts, strengths), best)


def held_out_mse(sums: Sums, penalty: FloatArray) -> float:
    """Mean squared error over all folds, each simulated with tables that the others gave."""
    xx, xy, count = sums.xx.sum(axis=0), sums.xy.sum(axis=0), sums.count.sum()
    total = 0.0
    for fold in np.flatnonzero(sums.count):
        x = solve(xx - sums.xx[fold] + (count - sums.count[fold]) * penalty, xy - sums.xy[fold])
        total += float(sums.yy[fold] - 2.0 * x @ sums.xy[fold] + x @ sums.xx[fold] @ x)
    return max(total, 0.0) / max(float(count), 1.0)


def _add(form: FloatArray, *columns: np.ndarray, rows: FloatArray) -> None:
    """Add the square of a difference: `columns` (K, L) of its members, `rows` (K, members) of weights."""
    for k in range(len(rows)):
        for line in range(columns[0].shape[1]):
            members = [int(c[k, line]) for c in columns]
            form[np.ix_(members, members)] += np.outer(rows[k], rows[k])
