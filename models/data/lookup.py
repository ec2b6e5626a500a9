"""Linear interpolation in tables over up to three axes, compiled; axes of one point are allowed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from models.data.timeseries import FloatArray


def nested_list(values: FloatArray) -> list[Any]:
    """Return nested lists of plain numbers; missing ones are null, which JSON knows and reading makes NaN again."""
    plain = values.astype(object)
    plain[np.isnan(values)] = None
    return plain.tolist()


@njit(cache=True)
def place(axis: np.ndarray, x: float, extend: bool) -> tuple[int, float]:
    """Return the interval of a rising axis that holds `x`, and how far in it `x` lies (0..1).

    Beyond the ends the nearer end counts, or with `extend` the straight line of the last interval.
    """
    last = axis.shape[0] - 1
    if last == 0:
        return 0, 0.0
    i = min(max(int(np.searchsorted(axis, x)) - 1, 0), last - 1)
    share = (x - axis[i]) / (axis[i + 1] - axis[i])
    if not extend:
        share = min(max(share, 0.0), 1.0)
    return i, share


@njit(cache=True)
def line(axis: np.ndarray, values: np.ndarray, x: float, extend: bool) -> float:
    """Value of a table over one axis."""
    i, share = place(axis, x, extend)
    if share == 0.0:
        return values[i]
    return values[i] + share * (values[i + 1] - values[i])


@njit(cache=True)
def surface(
    rows: np.ndarray, columns: np.ndarray, values: np.ndarray, row: float, column: float, extend: bool
) -> float:
    """Value of a table over rows (held at their ends) and columns (`extend` applies to them)."""
    i, share = place(rows, row, False)
    lower = line(columns, values[i], column, extend)
    if share == 0.0:
        return lower
    return lower + share * (line(columns, values[i + 1], column, extend) - lower)


@njit(cache=True)
def volume(
    layers: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    values: np.ndarray,
    layer: float,
    row: float,
    column: float,
) -> float:
    """Value of a table over layers, rows and columns, each held at its ends."""
    i, share = place(layers, layer, False)
    lower = surface(rows, columns, values[i], row, column, False)
    if share == 0.0:
        return lower
    return lower + share * (surface(rows, columns, values[i + 1], row, column, False) - lower)
