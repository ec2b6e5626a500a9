"""Stretches of samples without interruption."""

from __future__ import annotations

import numpy as np


def stretches(chosen: np.ndarray) -> list[tuple[int, int]]:
    """Return (first, one after the last) index of each stretch of True in an (n,) array, in their order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]
