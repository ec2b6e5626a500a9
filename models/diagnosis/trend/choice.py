"""Samples of a run that an estimate looks at."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.trend.settings import SETTINGS


def chosen(places: np.ndarray, count: int) -> np.ndarray:
    """At most `count` of the places, evenly spread, with both ends: there a cell is fullest or emptiest."""
    if len(places) <= count:
        return places
    return places[np.unique(np.round(np.linspace(0, len(places) - 1, count)).astype(np.int64))]


def around_steps(current_A: FloatArray, least_A: float) -> np.ndarray:
    """Samples just before and after the largest steps of the current: they alone tell quick resistance from the curve.

    Parameters
    ----------
    current_A : (n,)
    least_A : smallest step that is one
    """
    size = np.abs(np.diff(current_A))
    largest = np.argsort(-size, kind="stable")[: SETTINGS.steps]
    largest = largest[size[largest] >= least_A]
    every = largest[:, None] + 1 + np.array(SETTINGS.after_step)
    return np.unique(every[(every >= 0) & (every < len(current_A))])
