"""Thinning of samples for a picture: fewer rows, and every extreme still there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


def kept_rows(
    columns: Mapping[str, NDArray[Any]], n: int, max_points: int, shaped_by: Sequence[str]
) -> NDArray[np.intp]:
    """Choose the rows to keep: of each of equal buckets, those with the lowest and highest value of each column.

    Rows are kept whole and none is invented, so the result can be drawn, and compared, like the original.

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

    Returns
    -------
    numpy.ndarray
        Rising row numbers.
    """
    if n <= max(max_points, 2):
        return np.arange(n)
    shapes = [np.asarray(columns[name], np.float64) for name in shaped_by if name in columns]
    buckets = (max_points - 2) // (2 * len(shapes)) if shapes else max(max_points - 2, 0)
    if buckets <= 0:
        return np.array([0, n - 1])
    edges = np.linspace(0, n, buckets + 1).astype(np.intp)
    chosen = [np.array([0, n - 1]), *(_extremes(values, edges) for values in shapes)]
    return np.unique(np.concatenate(chosen if shapes else [chosen[0], edges[:-1]]))


def _extremes(values: NDArray[np.float64], edges: NDArray[np.intp]) -> NDArray[np.intp]:
    """Rows of the lowest and of the highest value between edges; a bucket of missing values has none."""
    rows: list[NDArray[np.intp]] = []
    for filled, pick in ((np.inf, np.minimum), (-np.inf, np.maximum)):
        present = np.where(np.isnan(values), filled, values)
        extreme = pick.reduceat(present, edges[:-1])
        bucket = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
        hits = np.flatnonzero((present == extreme[bucket]) & ~np.isnan(values))
        rows.append(hits[np.unique(bucket[hits], return_index=True)[1]])
    return np.concatenate(rows)
