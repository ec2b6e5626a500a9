"""Where a run shows a cell full or empty: there the counted charge tells its capacity, however its curve has changed.

Full and empty are what they were in the fresh cell: the state in which it would have the voltage that the run ends
with, under the same current. Resistance that has grown moves that by little, because a discharge ends where the curve
is steep; a charge that ends as its current falls at a held voltage ends full.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.trend.settings import SETTINGS
from models.effects.view import View

_CLOSE = 1e-4


@dataclass(frozen=True)
class Ends:
    """Samples at which a cell is full or empty.

    Attributes
    ----------
    index : (e,) samples
    soc, std : (e,) state of charge there, a fraction of what the cell holds now, and how surely
    """

    index: np.ndarray
    soc: FloatArray
    std: FloatArray


def ends_of(cell: KnownCell, run: GridRun, start: float) -> Ends:
    """Find the last samples of charge and discharge, where they end full or empty.

    Parameters
    ----------
    cell : as it was
    run, start : with its SoC at the start
    """
    index, found, stds = [], [], []
    low, high = cell.soc_range
    least_A = SETTINGS.load_C * cell.capacity_Ah
    for sign, full in ((1.0, True), (-1.0, False)):
        loaded = np.flatnonzero(run.measured & (sign * run.current_A >= least_A))
        if not len(loaded):
            continue
        last = _last(loaded)
        view = View(cell, run, start, last)
        # Of the very last one the current may have ended within its interval.
        behind = _soc_of(cell, view, run.voltage_V[last]) - view.soc[last]
        soc = float(np.median(behind)) + float(view.soc[last[-1]])
        at_its_end = soc >= high - SETTINGS.end_soc if full else soc <= low + SETTINGS.end_soc
        if at_its_end and low <= SETTINGS.end_soc and high >= 1.0 - SETTINGS.end_soc:
            index.append(int(last[-1]))
            found.append(high if full and _tapered(run, loaded) else soc)
            stds.append(SETTINGS.pulse_end_std if _pulsed(run, loaded) else SETTINGS.end_std)
    return Ends(np.array(index, dtype=np.int64), np.array(found), np.array(stds))


def _tapered(run: GridRun, loaded: np.ndarray) -> bool:
    """Whether a charge ended by its current falling at a held voltage: that is what full is, whatever has grown."""
    current_A = run.current_A[loaded]
    return float(current_A[-1]) < SETTINGS.tapered * float(np.max(current_A))


def _pulsed(run: GridRun, loaded: np.ndarray) -> bool:
    """Whether it ended in a pulse: what the model makes of that is less sure than what a steady current makes."""
    current_A = np.abs(run.current_A[loaded])
    return float(current_A[-1]) > SETTINGS.pulsed * float(np.mean(current_A))


def _last(loaded: np.ndarray) -> np.ndarray:
    """Samples at the end of a charge or discharge, without the last one where there are others."""
    last = loaded[-SETTINGS.end_samples - 1 :]
    return last[:-1] if len(last) > 1 else last


def _soc_of(cell: KnownCell, view: View, voltage_V: FloatArray) -> FloatArray:
    """(k,) states of charge in which the cell as it was has voltages at the samples of a view."""
    low, high = cell.soc_range
    below = np.full(len(voltage_V), low - SETTINGS.end_soc)
    above = np.full(len(voltage_V), high + SETTINGS.end_soc)
    while float(above[0] - below[0]) > _CLOSE:
        middle = 0.5 * (below + above)
        short = cell.voltage_V(view.inputs, middle) < voltage_V
        below, above = np.where(short, middle, below), np.where(short, above, middle)
    return 0.5 * (below + above)
