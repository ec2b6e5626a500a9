"""Samples that the logger lost, and what the counted charge is off by for it."""

from __future__ import annotations

import numpy as np

from models.data.lost_samples import tick_s
from models.data.resampling import GridRun
from models.pipeline.training import Training
from models.pipeline.usability.reason import Reason, limited

# What the counted charge may be off by at the end of a run, one standard deviation: 1 % of the capacity.
_MATTERS = 0.01


def lost_samples(data: Training) -> list[Reason]:
    """Whether so many samples are lost that the counted charge is not known."""
    both = zip(data.grid, data.runs, strict=True)
    gone = [run for run, series in both if tick_s(series.time_s) is not None]
    if not gone:
        return []
    drift = max(drift_Ah(run, gone) for run in gone) / data.cell.capacity_Ah
    if drift < _MATTERS:
        return []
    share = sum(run.n_missing for run in gone) / sum(len(run) for run in gone)
    return [
        limited(
            f"{100.0 * share:.0f} % of the samples are missing here and there: what flowed in between is not known, "
            f"and the counted charge may be off by {100.0 * drift:.1f} % of the capacity; mend the logger's link"
        )
    ]


def drift_Ah(run: GridRun, grid: list[GridRun]) -> float:
    """Standard deviation at a run's end of the charge counted over its lost samples.

    A lost sample's current is taken to be its neighbours' mean. What that is off by is seen where three samples in a
    row are there; a run's errors add up as independent ones do.
    """
    share = _share(grid)
    lost = ~run.measured
    first = np.flatnonzero(lost[1:] & ~lost[:-1]) + 1
    last = np.array([k + int(np.argmin(lost[k:])) if not lost[k:].all() else len(lost) - 1 for k in first], int)
    if not len(first):
        return 0.0
    apart = run.current_A[last] - run.current_A[first - 1]
    count = last - first
    return float(np.sqrt(np.sum((share[0] + share[1] * apart**2) * count**2))) * run.dt_s / 3600.0


def _share(grid: list[GridRun]) -> tuple[float, float]:
    """Mean square of what a current is off its neighbours' mean: a constant, and a share of their squared distance."""
    off, apart = [], []
    for run in grid:
        whole = run.measured[:-2] & run.measured[1:-1] & run.measured[2:]
        current = run.current_A
        off.append((current[1:-1] - 0.5 * (current[:-2] + current[2:]))[whole] ** 2)
        apart.append((current[2:] - current[:-2])[whole] ** 2)
    square, difference = np.concatenate(off), np.concatenate(apart)
    changed = difference > np.mean(difference) if len(difference) else np.zeros(0, bool)
    if not changed.any() or changed.all():
        return 0.0, 0.25
    return float(np.mean(square[~changed])), float(square[changed].sum() / difference[changed].sum())
