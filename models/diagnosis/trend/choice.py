"""Samples of a run that an estimate looks at."""

from __future__ import annotations

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.trend.ends import Ends
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


def looked_at(cell: KnownCell, run: GridRun, counted: FloatArray, ends: Ends) -> np.ndarray:
    """(m,) samples within the trained SoC: spread over the run, and those around steps of the current.

    Not those just above an empty end, where the curve is steep: the end itself tells what they would.

    Parameters
    ----------
    cell : as it was
    run : on its grid
    counted : (n,) state of charge
    ends : where the cell is full or empty

    Raises
    ------
    ModelError
        There is none.
    """
    low, high = cell.soc_range
    inside = run.measured & (counted >= low - KNOWN.away_soc) & (counted <= high + KNOWN.away_soc)
    if len(ends.soc) and ends.soc.min() < SETTINGS.end_soc + low:
        steep = counted <= low + SETTINGS.end_soc
        inside &= ~steep | (np.abs(run.current_A) < SETTINGS.load_C * cell.capacity_Ah)
    places = np.flatnonzero(inside)
    if not len(places):
        raise ModelError(
            f"{run.name}: no sample lies within the trained state of charge, {low:.2f} to {high:.2f}; give the right "
            "SoC at the start, or train on runs that cover it"
        )
    near = around_steps(run.current_A, SETTINGS.step_C * cell.capacity_Ah)
    return np.union1d(chosen(places, SETTINGS.points), near[inside[near]])
