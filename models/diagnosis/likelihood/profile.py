"""Evidence for an effect of one size: its likelihood over all sizes, each of them simulated, instead of a slope.

What an effect does to the voltage bends with its size, and so does the likelihood: over a curve with knots it has more
than one top. Steps along the slope end at the nearest, or nowhere. Here the likelihood is looked at over the whole
range first; from its highest place the steps go on, none of them downhill; around where they end it is summed up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background, Weighed
from models.diagnosis.likelihood.shapes import Moving
from models.diagnosis.likelihood.thresholds import THRESHOLDS

# Sizes in units of the usual one: the smallest is what a well-known cell shows, the largest the furthest mostly looked
# for, beyond which they go on by that factor.
_FURTHER = 1.4
_GRID = (0.05, 0.1, 0.2, 0.3, 0.45, 0.65, 0.9, 1.3, 1.9, 2.8, 4.0, 5.7, 8.0)
_AROUND = np.linspace(-4.0, 4.0, 9)
_TOPS, _STEPS, _HALVINGS, _SETTLED = 2, 4, 3, 0.2


@dataclass(frozen=True)
class Profile:
    """What was found.

    Attributes
    ----------
    size : likeliest
    at, columns : (N,) change there, (N, 1) derivative
    weighed : evidence, summed over all sizes
    """

    size: float
    at: FloatArray
    columns: FloatArray
    weighed: Weighed


def profile(back: Background, shape: Moving) -> Profile:
    """Likelihood of a shape of one size over all its sizes.

    Parameters
    ----------
    back : error and covariance
    shape : of one size, `shape.size` is 1
    """
    low, high = shape.limits[:, 0].tolist()
    steps = list(_GRID)
    while steps[-1] < max(-low, high):
        steps.append(_FURTHER * steps[-1])
    grid = [-each for each in steps] + [0.0] + steps
    if shape.from_best:
        grid = [0.0, *(start for (start,) in shape.starts)]
    seen = _Seen(back, shape)
    seen.look(np.unique(np.clip(grid, low, high)))
    for top in seen.tops(_TOPS):
        seen.climb(top)
    std, _ = seen.linear(seen.best)
    size = seen.best
    seen.look(np.clip(size + std * _AROUND, low, high))
    at, columns = shape.columns(np.array([size]))
    return Profile(size, at, columns, seen.summed())


class _Seen:
    """Sizes that were simulated, with the logarithm of likelihood and prior at each."""

    def __init__(self, back: Background, shape: Moving) -> None:
        self._back, self._shape = back, shape
        self._sizes, self._logs = np.zeros(0), np.zeros(0)

    @property
    def best(self) -> float:
        """The likeliest of them."""
        return float(self._sizes[np.argmax(self._logs)])

    def look(self, sizes: FloatArray) -> None:
        """Simulate more of them."""
        sizes = np.setdiff1d(sizes, self._sizes)
        if not len(sizes):
            return
        left = self._back.error[:, None] - np.column_stack([self._shape.simulate(np.array([each])) for each in sizes])
        logs = []
        scales = [scale for scale, _ in THRESHOLDS.effect_scales]
        for (scale, weight), white in zip(THRESHOLDS.effect_scales, self._back.whites(left, scales), strict=True):
            logs.append(np.log(weight) - self._back.log_root(scale) - 0.5 * np.sum(white**2, axis=0))
        prior = _log_prior(sizes, self._shape.limits[:, 0])
        found = np.logaddexp.reduce(np.array(logs), axis=0) - self._back.nothing + prior
        order = np.argsort(np.concatenate([self._sizes, sizes]))
        self._sizes = np.concatenate([self._sizes, sizes])[order]
        self._logs = np.concatenate([self._logs, found])[order]

    def tops(self, count: int) -> list[float]:
        """The highest of those that are likelier than the ones beside them."""
        padded = np.pad(self._logs, 1, constant_values=-np.inf)
        tops = np.flatnonzero((self._logs >= padded[:-2]) & (self._logs >= padded[2:]))
        return self._sizes[tops[np.argsort(-self._logs[tops])][:count]].tolist()

    def climb(self, here: float) -> None:
        """Go where the slope asks for, less far where that is downhill."""
        low, high = self._shape.limits[:, 0].tolist()
        for _ in range(_STEPS):
            std, asked = self.linear(here)
            was, asked = here, float(np.clip(asked, low, high))
            for _ in range(_HALVINGS):
                self.look(np.array([asked]))
                if self._log(asked) > self._log(here):
                    here = asked
                    break
                asked = 0.5 * (asked + here)
            if abs(here - was) < _SETTLED * std:
                break

    def _log(self, size: float) -> float:
        return float(self._logs[np.searchsorted(self._sizes, size)])

    def linear(self, size: float) -> tuple[float, float]:
        """Standard deviation by the slope at a size, and the size that the slope asks for."""
        at, columns = self._shape.columns(np.array([size]))
        whitened = self._back.whiten(columns, at - size * columns[:, 0])
        std = float(np.sqrt(self._back.weigh_whitened(whitened).covariance[0, 0]))
        return std, float(self._back.step(whitened)[0])

    def summed(self) -> Weighed:
        """Evidence, mean and variance, by trapezoids over all that was simulated."""
        most, gaps = float(self._logs.max()), np.diff(self._sizes)
        weight = np.exp(self._logs - most) * 0.5 * (np.append(gaps, 0.0) + np.insert(gaps, 0, 0.0))
        total = float(weight.sum())
        mean = float(weight @ self._sizes) / total
        variance = float(weight @ (self._sizes - mean) ** 2) / total
        return Weighed(most + float(np.log(total)), np.array([mean]), np.array([[variance]]))


def _log_prior(sizes: FloatArray, limits: FloatArray) -> FloatArray:
    """(n,) logarithm of the density of sizes within their (2,) limits, in units of the usual one."""
    at = np.array(THRESHOLDS.sizes)[:, None]
    logs = -0.5 * (sizes / at) ** 2 - np.log(at * np.sqrt(2.0 * np.pi) * np.diff(ndtr(limits / at)))
    return np.logaddexp.reduce(logs, axis=0) - np.log(len(at))
