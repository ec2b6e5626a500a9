"""Which training samples are kept back to judge choices: whole runs where there are several, else blocks in time."""

from __future__ import annotations

import numpy as np

from models.regression import Dataset

_BLOCKS_PER_FOLD = 5


def folds(data: Dataset, n_folds: int = 2) -> list[np.ndarray]:
    """Masks of held-out samples, one per fold.

    Parameters
    ----------
    data : training samples
    n_folds : how many

    Returns
    -------
    list of (N,) bool, True where held out. With four runs or more every third run is held out (another third in each
    fold); with fewer, blocks spread over each run, about a fifth of it. The free run passes through held-out blocks,
    so the error there is one of simulation, not of prediction from measured voltage.
    """
    n_runs = int(data.run_index.max()) + 1
    if n_runs >= 4:
        return [data.run_index % 3 == fold for fold in range(n_folds)]
    masks = []
    for fold in range(n_folds):
        mask = np.zeros(len(data), dtype=bool)
        for run in range(n_runs):
            index = np.flatnonzero(data.run_index == run)
            block = np.minimum((np.arange(len(index)) * 5 * _BLOCKS_PER_FOLD) // len(index), 5 * _BLOCKS_PER_FOLD - 1)
            mask[index[block % 5 == (1 + 2 * fold) % 5]] = True
        masks.append(mask)
    return masks
