"""What a bounded network does not know, from its errors on samples that were held out."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from models.data.timeseries import FloatArray
from models.identification.bounded.fitted import BoundedFit, curve_by_values, held_out_error, simulated
from models.identification.bounded.layout import Layout, soc_over
from models.identification.bounded.problem import blocks, fold_of, regressors
from models.identification.bounded.strengths import penalty
from models.network.regression import VOLTAGE
from models.uncertainty.bands import NORMAL_95
from models.uncertainty.correlation import ResidualCorrelation, fit_correlation
from models.uncertainty.covariance import ParameterCovariance
from models.uncertainty.expansion import Expansion
from models.uncertainty.model_uncertainty import Uncertainty

# Samples at which the parameters' variance is worked out.
_SAMPLES = 40_000
# A local level leans on that of all samples as if so many independent samples of it had been seen.
_PRIOR_SAMPLES = 10.0
_THIN_SHARE = 0.5
# Of the mean squared held-out error, as much at most is put down to what sampling leaves open of the coefficients.
_SAMPLING_SHARE = 0.05


def bounded_uncertainty(fit: BoundedFit) -> Uncertainty:
    """Learn what a bounded network does not know.

    The covariance has two parts. One is how far the fits that each left a fold out lie apart (the jackknife: Efron and
    Stein, Ann. Statist. 9, 1981, eq. 1.4): it knows of bounds and of what the form cannot do. The other is that of the
    penalised least squares, with residuals that hang together in time counted for what they are worth. It knows of no
    bounds but one: together the coefficients cannot be off by more than the held-out error shows.
    """
    layout, runs = fit.layout, fit.bank.runs
    starts = np.cumsum([0, *(len(run) for run in runs[:-1])])
    error = held_out_error(fit, fold_of(fit.bank))
    known = ~np.isnan(error)
    rows = regressors(fit.bank, layout.basis, layout.scale)
    soc = np.concatenate(soc_over(fit.bank, layout.basis.axis))
    voltage = np.concatenate([run.voltage_V for run in runs])
    near = _Near(layout.knots.soc, soc)
    seen = (voltage - simulated(layout, fit.coefficients, rows, soc)) ** 2
    level, least, correlation = _levels(near, known, error, seen, starts)
    chosen = np.flatnonzero(known)[:: max(1, int(known.sum()) // _SAMPLES)]
    sampling, determined = _covariance(fit, float(level.mean()), correlation)
    most = (
        _SAMPLING_SHARE
        * float(np.mean(error[chosen] ** 2))
        / float(np.nanmean(_variance(layout, sampling, rows, soc, chosen)))
    )
    covariance = _apart(fit) + min(1.0, most) * sampling
    variance = _variance(layout, covariance, rows, soc, chosen)
    picked = ~np.isnan(variance)
    level = np.maximum(near.local_mean(error**2 - np.nan_to_num(variance), picked, correlation), least)
    ratio = np.sqrt(error[picked] ** 2 / (variance[picked] + near.at(level)[picked]))
    own = near.counts(known)
    share = np.clip(determined[: layout.n_curve], 0.0, 1.0)
    return Uncertainty(
        parameters=_parameters(fit, covariance, _with_ends(share, 0.0)),
        level_V=_with_ends(np.sqrt(level)),
        samples=_with_ends(own, 0.0),
        effective_samples=_with_ends(own / correlation.inflation, 0.0),
        thin=_with_ends(share, 0.0) < _THIN_SHARE,
        band_factor=float(np.percentile(ratio, 95.0)) / NORMAL_95,
        correlation=correlation,
    )


def _levels(
    near: _Near, known: np.ndarray, error: FloatArray, seen: FloatArray, starts: np.ndarray
) -> tuple[FloatArray, FloatArray, ResidualCorrelation]:
    """(n,) squared held-out error near each knot in V^2, the least that it can be, and how errors hang together."""
    first = fit_correlation(error, starts)
    least = near.local_mean(seen, known, first)
    level = np.maximum(near.local_mean(error**2, known, first), least)
    return level, least, fit_correlation(error / np.sqrt(near.at(level)), starts)


def _variance(
    layout: Layout, covariance: FloatArray, rows: FloatArray, soc: FloatArray, chosen: np.ndarray
) -> FloatArray:
    """(N,) by the covariance of the coefficients in V^2 at the chosen samples; NaN at the others."""
    variance, factor = np.full(len(soc), np.nan), _root(covariance)
    for part, block, columns in blocks(layout, rows, soc, chosen):
        variance[part] = np.sum((block @ factor[columns]) ** 2, axis=1)
    return variance


class _Near:
    """Weights of samples at the knots of the curve, two for each."""

    def __init__(self, knots: FloatArray, soc: FloatArray) -> None:
        self._n = len(knots)
        self._left = np.clip(np.searchsorted(knots, soc, side="right") - 1, 0, self._n - 2)
        gap = knots[self._left + 1] - knots[self._left]
        self._share = np.clip((soc - knots[self._left]) / gap, 0.0, 1.0)

    def at(self, values: FloatArray) -> FloatArray:
        """(N,) values of the knots at the samples."""
        return (1.0 - self._share) * values[self._left] + self._share * values[self._left + 1]

    def counts(self, chosen: np.ndarray) -> FloatArray:
        """(n,) samples for which each knot weighs most."""
        nearest = self._left + (self._share > 0.5)
        return np.bincount(nearest[chosen], minlength=self._n).astype(np.float64)

    def local_mean(self, values: FloatArray, chosen: np.ndarray, correlation: ResidualCorrelation) -> FloatArray:
        """(n,) mean near each knot, leaning on that of all where few independent samples are."""
        part = chosen & ~np.isnan(values)
        weight = self._summed(np.ones(len(values)), part)
        local = self._summed(values, part) / np.maximum(weight, 1e-300)
        independent = weight / correlation.inflation
        return (independent * local + _PRIOR_SAMPLES * float(values[part].mean())) / (independent + _PRIOR_SAMPLES)

    def _summed(self, values: FloatArray, part: np.ndarray) -> FloatArray:
        left, share = self._left[part], self._share[part]
        below = np.bincount(left, (1.0 - share) * values[part], self._n)
        return np.asarray(below + np.bincount(left + 1, share * values[part], self._n), dtype=np.float64)


def _covariance(fit: BoundedFit, level2: float, correlation: ResidualCorrelation) -> tuple[FloatArray, FloatArray]:
    """(P, P) covariance in V^2, the curve by its values, and (P,) share of each that the data determine."""
    sums = fit.held.sums
    information = sums.xx.sum(axis=0)
    whole = information + float(sums.count.sum()) * penalty(sums, fit.log_strengths)
    at_bound = ~fit.held.whole(fit.log_strengths).free
    # At a sample about two coefficients of each term act.
    whole[np.diag_indices_from(whole)] += np.where(at_bound, correlation.inflation * len(sums.layout.basis.terms), 0.0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(whole), 1e-300))
    scaled = whole * np.outer(scale, scale) + 1e-10 * np.eye(len(whole))
    inverse = cho_solve(cho_factor(scaled), np.eye(len(whole))) * np.outer(scale, scale)
    n = sums.layout.n_curve
    by_values = np.eye(len(whole))
    by_values[:n, :n] = np.tril(np.ones((n, n)))
    back = np.eye(len(whole))
    back[:n, :n] = np.eye(n) - np.eye(n, k=-1)
    determined = np.sum((by_values @ inverse @ information) * back.T, axis=1)
    covariance = level2 * correlation.inflation * by_values @ inverse @ by_values.T
    return 0.5 * (covariance + covariance.T), determined


def _apart(fit: BoundedFit) -> FloatArray:
    """(P, P) covariance by the fits that each left a fold out, the curve by its values."""
    used = np.flatnonzero(fit.held.sums.count > 0.0)
    without = [fit.held.without(fit.log_strengths, int(fold)).x for fold in used]
    found = np.array([curve_by_values(fit.layout, x) for x in without])
    away = found - found.mean(axis=0)
    return (len(used) - 1.0) / len(used) * away.T @ away


def _root(covariance: FloatArray) -> FloatArray:
    """Factor F of a covariance F F'; what is not positive to rounding is left out."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def _parameters(fit: BoundedFit, covariance: FloatArray, data_share: FloatArray) -> ParameterCovariance:
    """The same in the network's units, column after column of its parameters."""
    layout = fit.layout
    order = np.concatenate([np.arange(layout.n_curve, layout.size), np.arange(layout.n_curve)])
    low, high = fit.bank.bounds(VOLTAGE)
    ordered = covariance[np.ix_(order, order)] / (high - low) ** 2
    # The triangle of a QR decomposition of any factor: no small eigenvalue can spoil it.
    triangle = np.asarray(np.linalg.qr(_root(ordered).T, mode="r")).T
    return ParameterCovariance(
        np.ascontiguousarray(triangle), 0, layout.n_curve + 2, 0, data_share, expansion_of(layout)
    )


def expansion_of(layout: Layout) -> Expansion:
    """Which knots of the network each column of its parameters is free at; the first and last knot only follow."""
    places = [tuple((layout.places(b) + 1).tolist()) for b in range(len(layout.basis.terms))]
    return Expansion(layout.knots.outer, (*places, tuple(range(1, layout.n_curve + 1))))


def _with_ends(values: FloatArray, end: float | None = None) -> FloatArray:
    """(n + 2,) values at the network's knots; the outermost as their neighbours where `end` is None."""
    first, last = (values[0], values[-1]) if end is None else (end, end)
    return np.concatenate([[first], values, [last]])
