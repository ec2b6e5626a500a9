"""Evidence for two effects at once: every pair from products that are made once."""

from __future__ import annotations

from itertools import pairwise

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
    products, right, base = [], [], []
    whites = back.whites(stacked, (scale for scale, _ in THRESHOLDS.effect_scales))
    for (scale, weight), white, error in zip(THRESHOLDS.effect_scales, whites, back.white_errors, strict=True):
        products.append(white.T @ white)
        right.append(white.T @ error)
        base.append(float(np.log(weight)) - back.log_root(scale) - 0.5 * float(error @ error))
    every, sides, bases = np.array(products), np.array(right), np.array(base)
    places = [np.arange(a, b) for a, b in pairwise(first)]
    out = []
    for i, j in couples:
        own, off = np.concatenate([places[i], places[j]]), first[-1] + np.array([i, j])
        out.append(log_sum(_logs(every, sides, bases, own, off).ravel()) - back.nothing)
    return out


def _logs(products: FloatArray, right: FloatArray, base: FloatArray, own: np.ndarray, off: np.ndarray) -> FloatArray:
    """(scales, sizes) logarithms of the likelihood of one pair.

    Parameters
    ----------
    products, right, base : (s, K, K), (s, K), (s,) for each scale
    own, off : numbers of the pair's columns, and of what is moved
    """
    left = right[:, own] - products[:, own[:, None], off].sum(axis=2)
    shifted = right[:, off].sum(axis=1) - 0.5 * products[:, off[:, None], off].sum(axis=(1, 2))
    values, vectors = np.linalg.eigh(products[:, own[:, None], own])
    turned = np.einsum("sij,si->sj", vectors, left)[:, None] ** 2
    squared = np.array(THRESHOLDS.sizes)[:, None] ** 2
    grown = np.maximum(values, 0.0)[:, None] * squared + 1.0
    gain = 0.5 * np.sum(turned * squared / grown - np.log(grown), axis=2)
    return (base + shifted)[:, None] + gain - np.log(len(THRESHOLDS.sizes))
