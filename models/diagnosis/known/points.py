"""Points of the training runs that a known cell is held against."""

from __future__ import annotations

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.effects.view import View

# Points of the training runs that are kept.
_POINTS = 600


def points(cell: KnownCell, runs: list[GridRun], soc: list[float]) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    """Run and sample of points spread over the runs, with (m, P) regressors."""
    total = sum(int(run.measured.sum()) for run in runs)
    number, index, rows = [], [], []
    for r, (run, start) in enumerate(zip(runs, soc, strict=True)):
        known = np.flatnonzero(run.measured)
        n = max(1, round(_POINTS * len(known) / total))
        chosen = known[spread(len(known), n, r)]
        view = View(cell, run, start, chosen)
        number.append(np.full(len(chosen), r))
        index.append(chosen)
        rows.append(cell.regressors(view.inputs, view.soc[chosen]))
    return np.concatenate(number), np.concatenate(index), np.vstack(rows)


def spread(n: int, count: int, seed: int) -> np.ndarray:
    """Numbers of `count` of n samples, one drawn from each of as many equal stretches."""
    count = min(n, count)
    edges = np.linspace(0, n, count + 1)
    drawn = np.random.default_rng(seed).uniform(size=count)
    return np.minimum((edges[:-1] + drawn * np.diff(edges)).astype(np.int64), n - 1)
