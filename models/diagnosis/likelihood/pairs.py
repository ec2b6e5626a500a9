"""Evidence for two effects at once: every pair from products that are made once."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background, log_sum
from models.diagnosis.likelihood.thresholds import THRESHOLDS


def pair_gains(
    back: Background,
    columns: list[FloatArray],
    moved: list[FloatArray | None],
    couples: list[tuple[int, int]],
) -> list[float]:
    """Logarithm of the likelihood of each pair, over that of nothing.

    Parameters
    ----------
    back : covariance and error
    columns : (N, k) of each effect, for usual sizes
    moved : (N,) of each, what is taken off the error first
    couples : numbers of the two effects
    """
    if not couples:
        return []
    first = np.cumsum([0, *(each.shape[1] for each in columns)])
    shift = [np.zeros(len(back.error)) if each is None else each for each in moved]
    stacked = np.column_stack([*columns, *shift])
    logs = np.empty((len(couples), len(THRESHOLDS.effect_scales), len(THRESHOLDS.sizes)))
    for s, (scale, weight) in enumerate(THRESHOLDS.effect_scales):
        white, error = back.white(stacked, scale), back.white_errors[s]
        products, right = white.T @ white, white.T @ error
        base = -float(np.sum(np.log(np.diag(back.root(scale))))) + float(np.log(weight))
        for c, (i, j) in enumerate(couples):
            own = np.concatenate([np.arange(first[i], first[i + 1]), np.arange(first[j], first[j + 1])])
            off = first[-1] + np.array([i, j])
            inner = products[np.ix_(own, own)]
            left = right[own] - products[np.ix_(own, off)].sum(axis=1)
            squared = float(error @ error - 2.0 * right[off].sum() + products[np.ix_(off, off)].sum())
            values, vectors = np.linalg.eigh(inner)
            turned = (vectors.T @ left) ** 2
            for g, size in enumerate(THRESHOLDS.sizes):
                grown = np.maximum(values, 0.0) * size**2 + 1.0
                gain = 0.5 * float(np.sum(turned * size**2 / grown)) - 0.5 * float(np.sum(np.log(grown)))
                logs[c, s, g] = base - 0.5 * squared + gain - np.log(len(THRESHOLDS.sizes))
    return [log_sum(each.ravel()) - back.nothing for each in logs]
