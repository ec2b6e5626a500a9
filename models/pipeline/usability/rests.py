"""Records in which the cell never rests."""

from __future__ import annotations

import numpy as np

from models.data.resampling import GridRun
from models.pipeline.training import Training
from models.pipeline.usability.reason import Reason, limited

# Of the largest current: below it a cell is as good as at rest.
_LOADED = 0.02
# Share of the time between the first load and the last that is at rest by chance, as where a load passes through zero.
_RARELY = 0.01


def no_rest(data: Training) -> list[Reason]:
    """Whether no run shows a cell come to rest after a load, because it did not or because somebody cut it out."""
    largest = max(float(np.abs(run.current_A).max()) for run in data.grid)
    if any(_at_rest(run, largest) > _RARELY for run in data.grid):
        return []
    return [
        limited(
            "no rest between loads: how the voltage relaxes is not seen, so slow resistances and the open-circuit "
            "voltage are told apart badly. If the rests were cut out of the log, put them back: what looks like one "
            "load after the other bends the model; else add rests of ten minutes"
        )
    ]


def _at_rest(run: GridRun, largest: float) -> float:
    """Share of the time after the first load that is at rest."""
    loaded = np.flatnonzero(np.abs(run.current_A) > _LOADED * largest)
    if not len(loaded):
        return 0.0
    return 1.0 - len(loaded) / (len(run) - loaded[0])
