"""Groups of training samples that are held out together when choices are judged."""

from __future__ import annotations

import numpy as np

from models.regression import Dataset

N_FOLDS = 5
_GROUPS = 10


def groups(data: Dataset) -> np.ndarray:
    """(N,) number of the group that each sample belongs to.

    Whole runs where there are at least as many as folds; else each run in blocks in time, long enough that a block
    spans operating points which the rest of its fold has not seen. The free run passes through held-out samples, so
    the error there is one of simulation, not of prediction from measured voltage.
    """
    n_runs = int(data.run_index.max()) + 1
    if n_runs >= N_FOLDS:
        return data.run_index.astype(np.int64)
    blocks = -(-_GROUPS // n_runs)
    out = np.empty(len(data), dtype=np.int64)
    for run in range(n_runs):
        index = np.flatnonzero(data.run_index == run)
        out[index] = run * blocks + (np.arange(len(index)) * blocks) // len(index)
    return out


def folds(n_groups: int) -> list[np.ndarray]:
    """Numbers of the groups that each fold holds out."""
    every = np.arange(n_groups)
    return [every[every % N_FOLDS == fold] for fold in range(min(N_FOLDS, n_groups))]
