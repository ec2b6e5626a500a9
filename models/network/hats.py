"""Hats: between two neighbouring knots along the state of charge a network is the straight blend of their local models.

Only two local models count at a time, so nothing here loops over all of them: the interval is found by bisection, and
two rows are blended. Beyond the outermost knots the local model there holds alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from models.data.errors import StructureError
from models.data.timeseries import FloatArray

# Compiled without counting references: called at each live sample.
_UNCOUNTED: dict[str, Any] = {"cache": True, "_nrt": False}


def knots_of(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """(M,) knots of a partition by hats: the middles of its boxes.

    Raises
    ------
    StructureError
        There is more than one axis, there are fewer than two knots, or they do not rise.
    """
    if lower.shape[1] != 1:
        raise StructureError(f"a partition by hats has one axis, along the state of charge; this one {lower.shape[1]}")
    knots = 0.5 * (lower[:, 0] + upper[:, 0])
    if len(knots) < 2:
        raise StructureError(f"a partition by hats needs at least 2 knots; {len(knots)} given")
    falling = np.flatnonzero(~(np.diff(knots) > 0.0))
    if len(falling):
        i = int(falling[0])
        raise StructureError(
            f"the knots of hats must rise strictly: knot {i} is {knots[i]:g}, knot {i + 1} {knots[i + 1]:g}"
        )
    return knots


def boxes_around(knots: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(M, 1) lower and upper edges of a box about each knot, half as far as the nearer neighbour to either side."""
    gap = np.diff(knots)
    half = 0.5 * np.minimum(np.concatenate([gap[:1], gap]), np.concatenate([gap, gap[-1:]]))
    return (knots - half)[:, None], (knots + half)[:, None]


@njit(**_UNCOUNTED)
def hat_interval(centres: np.ndarray, z: float) -> tuple[int, float]:
    """Knot i below z, and the weight of knot i + 1; that of knot i is what is left of 1.

    Parameters
    ----------
    centres : (M, 1) knots, rising
    z : normalised state of charge

    Returns
    -------
    i in 0..M-2, and a weight in 0..1; beyond the outermost knots exactly 0 or 1.
    """
    low, high = 0, centres.shape[0] - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if centres[middle, 0] <= z:
            low = middle
        else:
            high = middle
    below = centres[low, 0]
    return low, min(max((z - below) / (centres[low + 1, 0] - below), 0.0), 1.0)


@njit(**_UNCOUNTED)
def hat_slope(centres: np.ndarray, below: int, z: float) -> float:
    """Derivative by z of the weight that `hat_interval` gives to knot `below` + 1; 0 beyond the outermost knots."""
    low, high = centres[below, 0], centres[below + 1, 0]
    return 1.0 / (high - low) if low <= z < high else 0.0


@njit(cache=True)
def hat_validity(centres: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(N, M) validity functions at (N,) normalised states of charge."""
    out = np.zeros((z.shape[0], centres.shape[0]))
    for k in range(z.shape[0]):
        below, share = hat_interval(centres, z[k])
        out[k, below] = 1.0 - share
        out[k, below + 1] = share
    return out


@njit(cache=True)
def _blend_block(
    theta: np.ndarray,
    centres: np.ndarray,
    axis: np.ndarray,
    values: np.ndarray,
    tap_signal: np.ndarray,
    tap_lag: np.ndarray,
    depth: int,
    share: np.ndarray,
    out: np.ndarray,
) -> None:
    size, n_taps, last = out.shape[0], tap_signal.shape[0], centres.shape[0] - 2
    begin = 0
    while begin < size:
        below, share[begin] = hat_interval(centres, axis[begin])
        # Samples that follow each other mostly lie between the same two knots: they are blended tap by tap.
        low = -np.inf if below == 0 else centres[below, 0]
        high = np.inf if below == last else centres[below + 1, 0]
        first, per_z = centres[below, 0], 1.0 / (centres[below + 1, 0] - centres[below, 0])
        end = begin + 1
        while end < size and low <= axis[end] < high:
            share[end] = min(max((axis[end] - first) * per_z, 0.0), 1.0)
            end += 1
        here, next_one = theta[below], theta[below + 1]
        offset, step = here[n_taps], next_one[n_taps] - here[n_taps]
        for k in range(begin, end):
            out[k] = offset + share[k] * step
        for t in range(n_taps):
            row, start = values[tap_signal[t]], depth - tap_lag[t]
            gain, more = here[t], next_one[t] - here[t]
            for k in range(begin, end):
                out[k] += (gain + share[k] * more) * row[start + k]
        begin = end


# Seen through Any: the type checker takes a compiled function's arguments for those of a plain one.
blend_block: Any = _blend_block
"""Write the (size,) normalised output of a block without past outputs.

theta : (M, p); centres : (M, 1); axis : (size,) normalised state of charge; values : (S, depth + block) normalised
signals, of which the block's begin at `depth`; tap_signal, tap_lag : (p - 1,); share : (block,) room; out : (size,)
"""
