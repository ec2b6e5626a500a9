"""What a known cell leaves of its training runs: as fitted, where fits did not see them, and what it leaves open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.points import points
from models.diagnosis.known.scaled import solve_scaled
from models.diagnosis.known.training_starts import TrainingStarts
from models.identification.bounded.fitted import curve_by_values
from models.identification.bounded.strengths import HeldOut, penalty
from models.network.regression import SignalBank

# Independent samples that the runs are worth at least and at most: neighbouring errors hang together.
_INDEPENDENT = (600.0, 2500.0)


@dataclass(frozen=True)
class Left:
    """What a known cell leaves of points of the training runs.

    Attributes
    ----------
    run, index : (m,) which run and sample
    fitted_V, unseen_V : (m,) error as fitted, and by a fit to the other folds
    open_V2 : (m, m) covariance of the latter by what that fit leaves open of the coefficients
    rows : (m, P + K) derivatives of the voltage to the coefficients and to the unknown states at the starts
    information : (P + K, P + K) of these at all points, and beforehand
    point_V2 : variance of a point with which all points are worth as much as the runs
    """

    run: np.ndarray
    index: np.ndarray
    fitted_V: FloatArray
    unseen_V: FloatArray
    open_V2: FloatArray
    rows: FloatArray
    information: FloatArray
    point_V2: float


def left_of(
    cell: KnownCell,
    bank: SignalBank,
    held: HeldOut,
    logs: tuple[float, ...],
    starts: TrainingStarts | None,
    folds: np.ndarray,
) -> Left:
    """What a cell leaves of its training runs, and what fits leave of the folds that they did not see.

    Parameters
    ----------
    cell : fitted
    bank : training runs, as if each had begun where it is said to
    held, logs : form and strengths that it was fitted with
    starts : of the runs; None: they are known
    folds : (n,) of each sample
    """
    run, index, rows = points(cell, bank.runs, bank.initial_soc)
    voltage = np.array([bank.runs[r].voltage_V[i] for r, i in zip(run, index, strict=True)])
    fold = folds[np.cumsum([0, *(len(each) for each in bank.runs[:-1])])[run] + index]
    unseen, noise_V2 = np.empty(len(run)), noise_of(held, logs)
    open_V2 = np.zeros((len(run), len(run))) if starts is None else starts.open_V2(run, index, rows)
    for number in np.unique(fold):
        own = np.flatnonzero(fold == number)
        without = curve_by_values(held.sums.layout, held.without(logs, int(number)).x)
        unseen[own] = voltage[own] - rows[own] @ without
        open_V2[np.ix_(own, own)] += rows[own] @ covariance_of(held, logs, noise_V2, int(number)) @ rows[own].T
    fitted_V, count = voltage - rows @ cell.coefficients, float(held.sums.count.sum())
    before = count / noise_V2 * _by_values(penalty(held.sums, logs), held.sums.layout.n_curve)
    if starts is not None:
        begun = starts.columns(run, index)
        rows, before = np.hstack([rows, begun]), np.asarray(block_diag(before, np.eye(begun.shape[1])))
    point_V2 = noise_V2 * len(run) / count
    return Left(run, index, fitted_V, unseen, open_V2, rows, before + rows.T @ rows / point_V2, point_V2)


def noise_of(held: HeldOut, logs: tuple[float, ...]) -> float:
    """Squared held-out error in V^2 times how many samples stand for one independent one."""
    count = float(held.sums.count.sum())
    independent = float(np.clip(count / 10.0, *_INDEPENDENT))
    return held.mean_mse(logs) * count / independent


def covariance_of(held: HeldOut, logs: tuple[float, ...], noise_V2: float, without: int | None) -> FloatArray:
    """(P, P) in V^2, the curve by its values; bounds are left aside, so that nothing is exact."""
    sums = held.sums
    kept = np.arange(len(sums.count)) != (-1 if without is None else without)
    count = float(sums.count[kept].sum())
    whole = sums.xx[kept].sum(axis=0) + count * penalty(sums, logs)
    inverse = solve_scaled(whole, np.eye(len(whole)))
    n = sums.layout.n_curve
    inverse[:n] = np.cumsum(inverse[:n], axis=0)
    inverse[:, :n] = np.cumsum(inverse[:, :n], axis=1)
    return noise_V2 * 0.5 * (inverse + inverse.T)


def _by_values(form: FloatArray, n_curve: int) -> FloatArray:
    """(P, P) quadratic form of a curve's increments as one of its values."""
    out, inner = form.copy(), n_curve - 1
    out[:inner] -= form[1:n_curve]
    out[:, :inner] -= out[:, 1:n_curve].copy()
    return out
