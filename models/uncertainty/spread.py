"""Variance of what a network says, from the factor of its parameters' covariance and the local models that count there.

Of thousands of parameters only some dozen act at a place, as with hats. The rows of the factor that belong to them are
all that their variance needs, and are brought to as many columns as they are rows before many samples go through them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray

_BLOCK = 4096
# Parameters are looked at in groups of so many columns: those that are 0 by chance make no group of their own.
_COLUMNS = 16


@dataclass
class LocalFactor:
    """Factor of the parameters' covariance, and what it comes to over the parts of it that were asked for.

    Attributes
    ----------
    factor : (M p, P) factor F of the covariance F F' of `theta.ravel()`
    """

    factor: FloatArray
    _smaller: dict[tuple[int, int], FloatArray] = field(default_factory=dict)

    def variance(self, rows: FloatArray, begin: int, end: int) -> FloatArray:
        """(n,) variances of sums over the parameters from number `begin` up to `end`.

        Parameters
        ----------
        rows : (n, end - begin) derivatives to these parameters
        """
        part = self._smaller.get((begin, end))
        if part is None:
            part = self.factor[begin:end]
            # A factor of the same covariance with fewer columns; worth its price for many rows.
            if part.shape[1] > part.shape[0] and len(rows) > part.shape[0] // 2:
                part = np.asarray(np.linalg.qr(part.T, mode="r")).T
                self._smaller[begin, end] = part
        return np.sum((rows @ part) ** 2, axis=1)


def blended_variance(local: LocalFactor, validity: FloatArray, u: FloatArray) -> FloatArray:
    """(n,) variance of the output of a network without past outputs, normalised units.

    Parameters
    ----------
    local : of the network's parameters
    validity : (n, M)
    u : (n, p) regressors
    """
    counts = validity != 0.0
    first, last = counts.argmax(axis=1), counts.shape[1] - 1 - counts[:, ::-1].argmax(axis=1)
    out, p = np.empty(len(u)), u.shape[1]
    with threadpool_limits(1, user_api="blas"):
        for (low, high), index in _groups(first, last):
            rows = validity[index, low : high + 1, None] * u[index, None, :]
            out[index] = local.variance(rows.reshape(len(index), -1), low * p, (high + 1) * p)
    return out


def gradient_variance(local: LocalFactor, gradient: FloatArray) -> FloatArray:
    """(n,) variances by the delta method from (n, M p) derivatives to all parameters."""
    size = gradient.shape[1]
    used = gradient != 0.0
    first, last = used.argmax(axis=1) // _COLUMNS, (size - 1 - used[:, ::-1].argmax(axis=1)) // _COLUMNS
    out = np.zeros(len(gradient))
    with threadpool_limits(1, user_api="blas"):
        for (low, high), index in _groups(first, last):
            begin, end = low * _COLUMNS, min((high + 1) * _COLUMNS, size)
            out[index] = local.variance(gradient[index, begin:end], begin, end)
    return out


def _groups(first: np.ndarray, last: np.ndarray) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
    """Samples by the range that they use, no more than a block of them at a time."""
    width = int(last.max(initial=0)) + 1
    order = np.argsort(first * width + last, kind="stable")
    cuts = np.flatnonzero(np.diff((first * width + last)[order])) + 1
    for together in np.split(order, cuts):
        for begin in range(0, len(together), _BLOCK):
            index = together[begin : begin + _BLOCK]
            yield (int(first[index[0]]), int(last[index[0]])), index
