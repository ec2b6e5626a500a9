"""Where a run shows a cell full or empty: there the counted charge tells its capacity, however its curve has changed.

Full and empty are what they were in the fresh cell: the state in which it would have the voltage that the run ends
with, under the same current. Resistance that has grown moves that by little, because a charge ends with little current
and a discharge where the curve is steep.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.trend.settings import SETTINGS
from models.effects.view import View

_CLOSE = 1e-5


@dataclass(frozen=True)
class Ends:
    """Samples at which a cell is full or empty.

    Attributes
    ----------
    index : (e,) samples
    soc : (e,) state of charge there, a fraction of what the cell holds now
    """

    index: np.ndarray
    soc: FloatArray


def ends_of(cell: KnownCell, run: GridRun, start: float) -> Ends:
    """Find the last samples of charge and discharge, where they end full or empty.

    Parameters
    ----------
    cell : as it was
    run, start : with its SoC at the start
    """
    index, found = [], []
    low, high = cell.soc_range
    least_A = SETTINGS.load_C * cell.capacity_Ah
    for sign, full in ((1.0, True), (-1.0, False)):
        loaded = np.flatnonzero(run.measured & (sign * run.current_A >= least_A))
        if not len(loaded):
            continue
        last = loaded[-1:]
        soc = _soc_of(cell, View(cell, run, start, last), float(run.voltage_V[last[0]]))
        at_its_end = soc >= high - SETTINGS.end_soc if full else soc <= low + SETTINGS.end_soc
        if at_its_end and low <= SETTINGS.end_soc and high >= 1.0 - SETTINGS.end_soc:
            index.append(int(last[0]))
            found.append(soc)
    return Ends(np.array(index, dtype=np.int64), np.array(found))


def _soc_of(cell: KnownCell, view: View, voltage_V: float) -> float:
    """State of charge in which the cell as it was has a voltage at the one sample of a view."""
    low, high = cell.soc_range
    below, above = low - SETTINGS.end_soc, high + SETTINGS.end_soc
    while above - below > _CLOSE:
        middle = 0.5 * (below + above)
        if float(cell.voltage_V(view.inputs, np.array([middle]))[0]) < voltage_V:
            below = middle
        else:
            above = middle
    return 0.5 * (below + above)
