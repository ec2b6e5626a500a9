"""The nearest current, in squares, within bounds whose sum stays within a tube: exact, compiled.

With S the running sum, V_k(S) the least cost of the first k samples that end at S, and lambda = dV_k/dS, the inverse
S(lambda) is piecewise linear and rising, and one more sample adds clip(wanted + lambda, low, high) to it; the tube cuts
it off at both ends. Going back, lambda stays as it is but for those cuts. The dynamic program of Johnson, J. Comput.
Graph. Stat. 22, 2013, for a total variation, here with bounds.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def nearest_within(
    wanted: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    sum_low: np.ndarray,
    sum_high: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the projection.

    Parameters
    ----------
    wanted : (N,)
    low, high : (N,) bounds of each sample
    sum_low, sum_high : (N,) bounds of the sum up to and with each sample; some sequence keeps them all
    out : (N,) written
    """
    n = wanted.shape[0]
    total, inside = 0.0, True
    for k in range(n):
        out[k] = min(max(wanted[k], low[k]), high[k])
        total += out[k]
        inside = inside and sum_low[k] <= total <= sum_high[k]
    if inside:
        return
    # Knots of S(lambda), in the middle of a buffer: sorted places and changes of slope.
    place, change = np.empty(4 * n + 8), np.empty(4 * n + 8)
    head = tail = 2 * n + 4
    left = right = 0.0
    cut_low, cut_high = np.full(n, -np.inf), np.full(n, np.inf)
    for k in range(n):
        head, tail = _insert(place, change, head, tail, low[k] - wanted[k], 1.0)
        head, tail = _insert(place, change, head, tail, high[k] - wanted[k], -1.0)
        left, right = left + low[k], right + high[k]
        if left < sum_low[k]:
            head, cut_low[k] = _cut_left(place, change, head, tail, sum_low[k] - left)
            left = sum_low[k]
        if right > sum_high[k]:
            tail, cut_high[k] = _cut_right(place, change, head, tail, right - sum_high[k])
            right = sum_high[k]
    multiplier = 0.0
    for k in range(n - 1, -1, -1):
        multiplier = min(max(multiplier, cut_low[k]), cut_high[k])
        out[k] = min(max(wanted[k] + multiplier, low[k]), high[k])


@njit(cache=True)
def _insert(place: np.ndarray, change: np.ndarray, head: int, tail: int, at: float, slope: float) -> tuple[int, int]:
    """Insert a knot in order, moving the shorter side."""
    first, last = head, tail
    while first < last:
        middle = (first + last) // 2
        if place[middle] < at:
            first = middle + 1
        else:
            last = middle
    if first - head < tail - first:
        head -= 1
        for i in range(head, first - 1):
            place[i], change[i] = place[i + 1], change[i + 1]
        place[first - 1], change[first - 1] = at, slope
    else:
        for i in range(tail, first, -1):
            place[i], change[i] = place[i - 1], change[i - 1]
        tail += 1
        place[first], change[first] = at, slope
    return head, tail


@njit(cache=True)
def _cut_left(place: np.ndarray, change: np.ndarray, head: int, tail: int, missing: float) -> tuple[int, float]:
    """Cut off where S has risen by less than `missing`; returns the new head and where the cut lies."""
    slope, i = 0.0, head
    while i < tail:
        slope += change[i]
        if i + 1 == tail or (slope > 0.5 and slope * (place[i + 1] - place[i]) >= missing):
            break
        missing -= slope * (place[i + 1] - place[i])
        i += 1
    if i >= tail:
        return tail, np.inf
    at = place[i] + (missing / slope if slope > 0.5 else 0.0)
    place[i], change[i] = at, slope
    return i, at


@njit(cache=True)
def _cut_right(place: np.ndarray, change: np.ndarray, head: int, tail: int, missing: float) -> tuple[int, float]:
    """Cut off where S still rises by less than `missing`; returns the new tail and where the cut lies."""
    slope, i = 0.0, tail - 1
    while i >= head:
        slope -= change[i]
        if i == head or (slope > 0.5 and slope * (place[i] - place[i - 1]) >= missing):
            break
        missing -= slope * (place[i] - place[i - 1])
        i -= 1
    if i < head:
        return head, -np.inf
    at = place[i] - (missing / slope if slope > 0.5 else 0.0)
    place[i], change[i] = at, -slope
    return i + 1, at
