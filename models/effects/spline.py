"""Cubic splines as a linear basis: clamped at the ends, straight beyond them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from models.timeseries import FloatArray

_ORDER = 3


@dataclass(frozen=True)
class SplineBasis:
    """Smooth bumps between two ends that add up to 1.

    Attributes
    ----------
    low, high : ends
    size : number of bumps; at least 4
    """

    low: float
    high: float
    size: int

    @cached_property
    def knots(self) -> FloatArray:
        """(size + 4,) knots, those at the ends repeated."""
        inner = np.linspace(self.low, self.high, self.size - _ORDER + 1)
        return np.concatenate([[self.low] * _ORDER, inner, [self.high] * _ORDER])

    @cached_property
    def centres(self) -> FloatArray:
        """(size,) where each bump weighs most (Greville abscissae)."""
        return np.array([self.knots[i + 1 : i + _ORDER + 1].mean() for i in range(self.size)])

    def matrix(self, x: FloatArray) -> FloatArray:
        """(n, size) values of the bumps; on a straight line beyond the ends."""
        inside = np.clip(x, self.low, self.high)
        out = BSpline.design_matrix(inside, self.knots, _ORDER).toarray()
        beyond = np.flatnonzero(x != inside)
        if len(beyond):
            out[beyond] += (x - inside)[beyond, None] * self._end_slopes[(x[beyond] > self.high).astype(np.int64)]
        return out

    @cached_property
    def _end_slopes(self) -> FloatArray:
        """(2, size) derivatives of the bumps at the low and the high end."""
        step = 1e-4 * (self.high - self.low)
        points = np.array([self.low, self.low + step, self.high - step, self.high])
        values = BSpline.design_matrix(points, self.knots, _ORDER).toarray()
        return np.array([values[1] - values[0], values[3] - values[2]]) / step

    def roughness(self, order: int) -> FloatArray:
        """(size, size) quadratic form of the differences of an order between neighbouring coefficients."""
        difference = np.diff(np.eye(self.size), order, axis=0)
        return difference.T @ difference
