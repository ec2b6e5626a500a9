"""A current sensor that seems to read a constant too much."""

from __future__ import annotations

import numpy as np

from models.data.lost_samples import tick_s
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.pipeline.training import Training
from models.pipeline.usability.reason import Reason, limited

# What the counted charge may be off by, at the end of the longest run, before it matters: 1 % of the capacity.
_MATTERS = 0.01
# A reference has an error of its own, and charge that does not come out again drifts as an offset does.
_MATTERS_OF_REFERENCE = 0.03
# Standard errors beyond which a reading is no chance.
_CERTAIN = 4.0
_SIGMA_OF_MAD = 1.48
# A current that stays so near to one value for a minute, far below the loads, is what the sensor reads at rest: nobody
# loads a cell with a thirtieth of the largest current of a test.
_REST_SHARE, _REST_S = 0.03, 60.0
# In less than this nobody has seen what a sensor reads at rest, only a small load.
_LEAST_REST_S = 600.0
# Errors of a count hang together for as long as a run lasts; its trend is known no better than its scatter over so many
# independent stretches.
_STRETCHES = 10.0
# Of the drift that a trend says, so much at least must be seen.
_SEEN_SHARE = 0.25


def suspected_offset(data: Training) -> list[Reason]:
    """Whether readings at rest, or a reference of the charge, say that the current sensor is off."""
    longest_h = max(run.duration_s for run in data.runs) / 3600.0
    least_A = _MATTERS * data.cell.capacity_Ah / longest_h
    off_A, how = _at_rest_A(data.grid), "it reads {} with the output off"
    if off_A is None or abs(off_A) < least_A:
        off_A, how = _against_reference_A(data), "the counted charge drifts from the runs' reference by {}"
        least_A *= _MATTERS_OF_REFERENCE / _MATTERS
    if off_A is None or abs(off_A) < least_A:
        return []
    drift = abs(off_A) * longest_h / data.cell.capacity_Ah
    return [
        limited(
            f"the current sensor seems to have an offset: {how.format(f'{1e3 * off_A:+.0f} mA')}, "
            f"{100.0 * drift:.0f} % of the capacity over the longest run; zero the sensor and record again, or take "
            "the offset off the current"
        )
    ]


def _at_rest_A(grid: list[GridRun]) -> float | None:
    """Mean reading in A while nothing seems to flow; None where that is 0 within its error, or never."""
    largest = max(float(np.abs(run.current_A).max()) for run in grid)
    readings = [part for run in grid for part in _rests(run, _REST_SHARE * largest)]
    if sum(len(part) for part in readings) * grid[0].dt_s < _LEAST_REST_S:
        return None
    # Readings within a rest hang together: each rest counts once. A median, because a small load may be among them.
    means = np.array([float(part.mean()) for part in readings])
    middle = float(np.median(means))
    # An offset is there in the long rests as well: fifty minutes of small currents are no offset where a night reads 0.
    by_length = _weighted_median(means, np.array([len(part) for part in readings]))
    middle = min(middle, by_length, key=abs) if middle * by_length > 0.0 else 0.0
    within = np.concatenate([part - part.mean() for part in readings])
    between = _SIGMA_OF_MAD * float(np.median(np.abs(means - middle)))
    error = float(np.hypot(np.std(within), between)) / np.sqrt(len(readings))
    return middle if abs(middle) > _CERTAIN * error else None


def _weighted_median(values: FloatArray, weight: np.ndarray) -> float:
    order = np.argsort(values)
    share = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(share, 0.5 * share[-1])])


def _rests(run: GridRun, most_A: float) -> list[FloatArray]:
    """Readings of each stretch of at least a minute in which next to nothing flows, its edges left out."""
    still = np.abs(run.current_A) <= most_A
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    least = max(_REST_S / run.dt_s, 3.0)
    return [
        run.current_A[first + 1 : last - 1]
        for first, last in zip(edges[::2], edges[1::2], strict=True)
        if last - first - 2 >= least
    ]


def _against_reference_A(data: Training) -> float | None:
    """Trend in A of the counted charge against a reference that runs along, if it is certain."""
    found = []
    for run, series, soc in zip(data.grid, data.runs, data.counted_soc(), strict=True):
        # Where samples are lost the count drifts by itself.
        if tick_s(series.time_s) is not None:
            continue
        if run.soc_ref is None or np.isnan(run.soc_ref).any() or np.ptp(run.soc_ref) == 0.0:
            continue
        # A wrong capacity drifts with the charge that was moved, an offset with time.
        away = soc - run.soc_ref
        columns = np.column_stack([run.time_s, run.soc_ref - run.soc_ref[0], np.ones(len(run))])
        solution, _, rank, _ = np.linalg.lstsq(columns, away, rcond=None)
        left = away - columns @ solution
        # Under one current charge moves as time does, and neither tells which of the two it is.
        alone_s = run.time_s - columns[:, 1:] @ np.linalg.lstsq(columns[:, 1:], run.time_s, rcond=None)[0]
        spread = float(np.std(alone_s)) * np.sqrt(_STRETCHES)
        error = float(np.std(left)) / max(spread, 1e-9)
        # A trend that hardly shows in the count, because a capacity just as wrong hides it, is none that was seen.
        seen = float(np.ptp(away)) >= _SEEN_SHARE * abs(solution[0]) * float(run.time_s[-1])
        if rank == columns.shape[1] and seen and abs(solution[0]) > _CERTAIN * error:
            found.append(float(solution[0]) * 3600.0 * data.cell.capacity_Ah)
    return float(np.median(found)) if found else None
