"""What judged runs would be like with nothing new: noise, open parameters, unknown starts, and error elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.thresholds import THRESHOLDS

_JITTER = 1e-10
_SCALES = tuple(scale for scale, _ in THRESHOLDS.effect_scales)


def log_sum(logs: list[float] | FloatArray) -> float:
    """Logarithm of a sum, from logarithms."""
    values = np.asarray(logs, dtype=np.float64)
    most = float(values.max())
    return most + float(np.log(np.sum(np.exp(values - most))))


@dataclass(frozen=True)
class Weighed:
    """An effect's evidence.

    Attributes
    ----------
    log_likelihood : over that of nothing
    mean, covariance : (k,), (k, k) of its sizes, in units of the usual ones
    """

    log_likelihood: float
    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Whitened:
    """Columns and what they are to explain, by the root of one covariance.

    Attributes
    ----------
    columns, error : (N, k), (N,)
    """

    columns: FloatArray
    error: FloatArray


@dataclass(frozen=True)
class Background:
    """Error of judged runs, and its covariance where nothing is new.

    Attributes
    ----------
    error : (N,) measured less simulated, the voltage in V and then the temperature in K
    fixed : (N, N) covariance of what is known as it is
    elsewhere : (N, N) covariance of the model's own error, which may be larger or smaller than was learned
    tempering : power of the likelihood beside that of nothing
    starts : (N, k) columns of variance 1 of what is open at the start of each run and fades, which `fixed` has, too;
        None: nothing is
    """

    error: FloatArray
    fixed: FloatArray
    elsewhere: FloatArray
    tempering: float = THRESHOLDS.tempering
    starts: FloatArray | None = None

    def part(self, rows: slice) -> Background:
        """Some of the points alone: those of the voltage, or of the temperature, by their places."""
        fixed, elsewhere = self.fixed[rows, rows], self.elsewhere[rows, rows]
        return Background(self.error[rows], fixed, elsewhere, self.tempering)

    def white(self, columns: FloatArray, scale: float) -> FloatArray:
        """(N, k) or (N,) columns by a root of the covariance, the error elsewhere `scale` times as large as learned."""
        return next(self.whites(columns, (scale,)))

    def whites(self, columns: FloatArray, scales: Iterable[float]) -> Iterator[FloatArray]:
        """The same for several scales, for little more than one."""
        _, turn, ratios = self._axes
        turned = turn @ columns
        for scale in scales:
            spread = np.sqrt(1.0 + scale**2 * ratios)
            yield turned / (spread if turned.ndim == 1 else spread[:, None])

    def log_root(self, scale: float) -> float:
        """Logarithm of the determinant of the root."""
        log_fixed, _, ratios = self._axes
        return log_fixed + 0.5 * float(np.sum(np.log1p(scale**2 * ratios)))

    @cached_property
    def _axes(self) -> tuple[float, FloatArray, FloatArray]:
        """Logarithm of the root of `fixed`, and (N, N), (N,) by which it becomes 1 and `elsewhere` a diagonal.

        One matrix is a root for all scales, of which a search asks thousands of times.
        """
        fixed = self.fixed.copy()
        fixed[np.diag_indices_from(fixed)] *= 1.0 + _JITTER
        root = cholesky(fixed, lower=True, check_finite=False)
        half = solve_triangular(root, self.elsewhere, lower=True, check_finite=False)
        ratios, axes = np.linalg.eigh(solve_triangular(root, half.T, lower=True, check_finite=False))
        turn = solve_triangular(root, axes, lower=True, trans=1, check_finite=False).T
        return float(np.sum(np.log(np.diag(root)))), np.ascontiguousarray(turn), np.maximum(ratios, 0.0)

    @cached_property
    def white_errors(self) -> list[FloatArray]:
        """(N,) error by the root, for each scale of `effect_scales`."""
        return list(self.whites(self.error, _SCALES))

    def log_of_nothing(self, scales: tuple[float, ...], weights: tuple[float, ...]) -> float:
        """Logarithm of the likelihood where nothing is new, up to a constant."""
        logs = [self._log(scale) + np.log(w) for scale, w in zip(scales, weights, strict=True)]
        return log_sum(logs)

    def _log(self, scale: float) -> float:
        white = self.white(self.error, scale)
        return float(-0.5 * white @ white) - self.log_root(scale)

    @cached_property
    def nothing(self) -> float:
        """Logarithm of the likelihood where nothing is new."""
        return self.log_of_nothing(THRESHOLDS.scales, THRESHOLDS.scale_weights)

    @cached_property
    def unknown(self) -> float:
        """Gain of the logarithm where something is there that no effect stands for."""
        scales = THRESHOLDS.unknown_scales
        return self.log_of_nothing(scales, (1.0 / len(scales),) * len(scales)) - self.nothing

    def weigh(self, columns: FloatArray, moved: FloatArray | None = None) -> Weighed:
        """Evidence for columns of usual sizes.

        Parameters
        ----------
        columns : (N, k)
        moved : (N,) what is taken off the error first, where the columns are derivatives about a value
        """
        return self.weigh_whitened(self.whiten(columns, moved))

    def whiten(self, columns: FloatArray, moved: FloatArray | None = None) -> list[Whitened]:
        """Columns, and the error less what is moved, by the root, for each scale of `effect_scales`."""
        stacked, k = columns if moved is None else np.column_stack([columns, moved]), columns.shape[1]
        out = []
        for white, white_error in zip(self.whites(stacked, _SCALES), self.white_errors, strict=True):
            out.append(Whitened(white[:, :k], white_error if moved is None else white_error - white[:, k]))
        return out

    def weigh_whitened(self, whitened: list[Whitened]) -> Weighed:
        """Evidence for columns of usual sizes: all scales and sizes at once, as it is asked thousands of times."""
        logs, means, covariances = self._by_scale_and_size(whitened)
        total = log_sum(logs)
        share = np.exp(logs - total)
        mean = np.einsum("sg,sgi->i", share, means)
        covariance = np.einsum("sg,sgij->ij", share, covariances) + _spread(share, means, mean)
        return Weighed(total - self.nothing, mean, covariance)

    def less_sure(self, columns: FloatArray, moved: FloatArray | None, factor: float) -> FloatArray:
        """(k, k) by how much more is open of sizes where the error elsewhere is `factor` times as uncertain.

        How likely each scale is stays as it is: what is doubted is what a scale stands for.
        """
        logs, _, covariances = self._by_scale_and_size(self.whiten(columns, moved))
        share = np.exp(logs - log_sum(logs))
        wide = list(self.whites(columns, [factor * scale for scale in _SCALES]))
        wider = _covariances(np.array([each.T @ each for each in wide])) - covariances
        return np.einsum("sg,sgij->ij", share, wider)

    def _by_scale_and_size(self, whitened: list[Whitened]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(s, g) logarithms of the likelihood, (s, g, k) means and (s, g, k, k) covariances of sizes."""
        at = THRESHOLDS
        inner = np.array([each.columns.T @ each.columns for each in whitened])
        right = np.array([each.columns.T @ each.error for each in whitened])
        base = np.array(
            [
                -0.5 * float(each.error @ each.error) - self.log_root(scale) + np.log(weight / len(at.sizes))
                for each, (scale, weight) in zip(whitened, at.effect_scales, strict=True)
            ]
        )
        covariances = _covariances(inner)
        means = np.einsum("sgij,sj->sgi", covariances, right)
        squared = np.array(at.sizes)[:, None, None] ** 2
        grown = -0.5 * np.linalg.slogdet(covariances / squared)[1]
        return base[:, None] + 0.5 * np.einsum("sgi,si->sg", means, right) - grown, means, covariances

    def step(self, whitened: list[Whitened]) -> FloatArray:
        """(k,) likeliest sizes for a usual scale and large effects, to go to next."""
        usual = whitened[THRESHOLDS.scales.index(1.0)]
        inner = usual.columns.T @ usual.columns
        return np.linalg.solve(inner + np.eye(len(inner)) / max(THRESHOLDS.sizes) ** 2, usual.columns.T @ usual.error)


def _covariances(inner: FloatArray) -> FloatArray:
    """(s, g, k, k) covariances of sizes, by (s, k, k) what the samples say of them, for each of the usual sizes."""
    squared = np.array(THRESHOLDS.sizes)[:, None, None] ** 2
    return np.linalg.inv(inner[:, None] + np.eye(inner.shape[1]) / squared)


def _spread(share: FloatArray, means: FloatArray, mean: FloatArray) -> FloatArray:
    """(k, k) covariance of (s, g, k) means, each as likely as its share."""
    away = means - mean
    return np.einsum("sg,sgi,sgj->ij", share, away, away)
