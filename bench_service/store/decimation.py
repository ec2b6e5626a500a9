"""Thinning of samples for a picture: fewer rows, every extreme and every step still there.

Of each of equal buckets the rows with the lowest and the highest value of each column stay (Jugel et al., "M4", PVLDB
7(10), 2014, who also keep a bucket's ends); of a column that moves in steps both rows at each step stay as well, as
long as there are few enough of them, so that an edge is drawn where it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Of the rows that may be kept, those that steps may take; with more steps than that their extremes have to do.
_STEPS_SHARE = 2


def kept_rows(
    columns: Mapping[str, NDArray[Any]],
    n: int,
    max_points: int,
    shaped_by: Sequence[str],
    stepped_by: Sequence[str] = (),
) -> NDArray[np.intp]:
    """Choose the rows to keep. Rows are kept whole and none is invented, so the result can be drawn like the original.

    Parameters
    ----------
    columns : mapping of str to array, shape (n,)
        NaN is a missing value, never an extreme.
    n : int
        Number of rows.
    max_points : int
        Largest number of rows to keep; at least the first and the last one are.
    shaped_by : sequence of str
        Columns whose extremes count.
    stepped_by : sequence of str
        Columns that hold a value until it changes: the rows before and after each change count.

    Returns
    -------
    numpy.ndarray
        Rising row numbers.
    """
    if n <= max(max_points, 2):
        return np.arange(n)
    steps = _steps([np.asarray(columns[name]) for name in stepped_by if name in columns], max_points // _STEPS_SHARE)
    shapes = [np.asarray(columns[name], np.float64) for name in shaped_by if name in columns]
    left = max(max_points - 2 - len(steps), 0)
    buckets = left // (2 * len(shapes)) if shapes else left
    ends = np.array([0, n - 1])
    if buckets <= 0:
        return ends
    edges = np.linspace(0, n, buckets + 1).astype(np.intp)
    chosen = [_extremes(values, edges) for values in shapes] if shapes else [edges[:-1]]
    return np.unique(np.concatenate([ends, steps, *chosen]))


def _steps(columns: Sequence[NDArray[Any]], most: int) -> NDArray[np.intp]:
    """Rows before and after each change of any column; none of them where there are more than `most`."""
    changed = np.zeros(0, np.intp)
    for values in columns:
        after = np.flatnonzero(values[1:] != values[:-1]) + 1
        # A missing value differs from itself: where both are missing nothing has changed.
        if values.dtype.kind == "f":
            after = after[~(np.isnan(values[after]) & np.isnan(values[after - 1]))]
        changed = np.union1d(changed, np.concatenate([after - 1, after]))
        if len(changed) > most:
            return np.zeros(0, np.intp)
    return changed.astype(np.intp)


def _extremes(values: NDArray[np.float64], edges: NDArray[np.intp]) -> NDArray[np.intp]:
    """Rows of the lowest and of the highest value between edges; a bucket of missing values has none."""
    missing = np.isnan(values)
    low, high = (np.where(missing, end, values) for end in (np.inf, -np.inf)) if missing.any() else (values, values)
    rows: list[int] = []
    # Bucket by bucket: a search within a bucket is several times faster than one pass over everything.
    for first, last in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        lowest, highest = first + int(low[first:last].argmin()), first + int(high[first:last].argmax())
        if not missing[lowest]:
            rows += (lowest, highest)
    return np.array(rows, np.intp)
