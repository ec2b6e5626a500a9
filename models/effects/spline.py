"""Cubic splines as a linear basis: clamped at the ends, straight beyond them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np

from models.data.timeseries import FloatArray

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
        intervals = self.size - _ORDER
        own = np.minimum((inside - self.low) * (intervals / (self.high - self.low)), intervals - 1).astype(np.int64)
        along = (inside - self.knots[_ORDER + own])[:, None]
        cubic, square, linear, constant = (np.take(each, own, axis=0) for each in self._pieces)
        values = ((cubic * along + square) * along + linear) * along + constant
        out = np.zeros((len(x), self.size))
        np.put(out, (np.arange(len(x)) * self.size + own)[:, None] + np.arange(_ORDER + 1), values)
        beyond = np.flatnonzero(x != inside)
        if len(beyond):
            out[beyond] += (x - inside)[beyond, None] * self._end_slopes[(x[beyond] > self.high).astype(np.int64)]
        return out

    @cached_property
    def _pieces(self) -> FloatArray:
        """(4, intervals, 4) coefficients of the bumps that are not zero in an interval, highest power first."""
        from scipy.interpolate import BSpline  # 400 ms of processor time, which a control process does without

        bumps, first = BSpline(self.knots, np.eye(self.size), _ORDER), np.arange(self.size - _ORDER)
        left = self.knots[_ORDER + first]
        taylor = np.array([bumps(left, nu=power) / factorial(power) for power in range(_ORDER, -1, -1)])
        return taylor[:, first[:, None], first[:, None] + np.arange(_ORDER + 1)]

    @cached_property
    def _end_slopes(self) -> FloatArray:
        """(2, size) derivatives of the bumps at the low and the high end."""
        out = np.zeros((2, self.size))
        width = (self.high - self.low) / (self.size - _ORDER)
        powers = np.array([3.0, 2.0, 1.0, 0.0])[:, None]
        out[0, : _ORDER + 1] = self._pieces[2, 0]
        steep = self._pieces[:, -1] * powers * width ** np.maximum(powers - 1.0, 0.0)
        out[1, -_ORDER - 1 :] = steep.sum(axis=0)
        return out

    def roughness(self, order: int) -> FloatArray:
        """(size, size) quadratic form of the differences of an order between neighbouring coefficients."""
        difference = np.diff(np.eye(self.size), order, axis=0)
        return difference.T @ difference
