"""A current sensor that seems to read a constant too much."""

from __future__ import annotations

import numpy as np

from models.data.lost_samples import tick_s
from models.data.resampling import GridRun
from models.data.stretches import stretches
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
# Errors of a count hang together for as long as a run lasts; its trend is known no better than by what so many
# independent stretches say.
_STRETCHES = 10
# Below this share two directions are one but for rounding.
_COLLINEAR = 1e-9
# Drift over the longest run, a fraction of the capacity, that no reference tells from none.
_NEGLIGIBLE = 1e-3
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
    least = max(_REST_S / run.dt_s, 3.0)
    return [run.current_A[first + 1 : last - 1] for first, last in stretches(still) if last - first - 2 >= least]


def _against_reference_A(data: Training) -> float | None:
    """Trend in A of the counted charge against a reference that runs along, if it is certain."""
    found = []
    longest_s, drift = 0.0, 0.0
    for run, series, soc in zip(data.grid, data.runs, data.counted_soc(), strict=True):
        # Where samples are lost the count drifts by itself.
        if tick_s(series.time_s) is not None:
            continue
        if run.soc_ref is None or np.isnan(run.soc_ref).any() or np.ptp(run.soc_ref) == 0.0:
            continue
        away = soc - run.soc_ref
        if run.time_s[-1] > longest_s:
            longest_s, drift = float(run.time_s[-1]), float(np.ptp(away))
        # Each run has a scale of its own: a reference is often a share of the charge of its own run.
        if (trend := _trend(run.time_s, run.soc_ref, away)) is not None:
            found.append(trend)
    if not found:
        return None
    per_s, error = _pooled(np.array(found), _NEGLIGIBLE / longest_s)
    # A trend that hardly shows in the count, because a capacity just as wrong hides it, is none that was seen. It shows
    # most in the longest run.
    seen = drift >= _SEEN_SHARE * abs(per_s) * longest_s
    return per_s * 3600.0 * data.cell.capacity_Ah if seen and abs(per_s) > _CERTAIN * error else None


def _trend(time_s: FloatArray, soc_ref: FloatArray, away: FloatArray) -> tuple[float, float] | None:
    """Drift per second beside that with the charge, and its standard error; None where nothing tells the two apart.

    A wrong capacity drifts with the charge that was moved, an offset with time. Errors of a count add up, so that its
    level hangs together over the run; what is added in one stretch does not hang on what is added in another.
    """
    edges = np.unique(np.linspace(0, len(time_s) - 1, _STRETCHES + 1).astype(int))
    columns = np.column_stack([np.diff(time_s[edges]), np.diff(soc_ref[edges])])
    drift = np.diff(away[edges])
    unit = np.linalg.norm(columns, axis=0)
    if len(columns) <= columns.shape[1] or not unit.all():
        return None
    basis, triangle = np.linalg.qr(columns / unit)
    # Under one current charge moves as time does. Where one stretch alone tells the two apart, nothing confirms it: a
    # step of the current that one of both counts half a sample later looks like an offset of amperes then.
    others = 1.0 - np.sum(basis**2, axis=1)
    if abs(triangle[-1, -1]) < _COLLINEAR or others.min() < _COLLINEAR:
        return None
    of_drift = np.linalg.solve(triangle, basis.T)[0] / unit[0]
    left = drift - basis @ (basis.T @ drift)
    # What each stretch is off by from what the others say of it (a jackknife).
    return float(of_drift @ drift), float(np.linalg.norm(of_drift * left / others))


def _pooled(trends: np.ndarray, least_error: float) -> tuple[float, float]:
    """Mean of the runs' trends by their errors, and its standard error, larger where the runs do not agree."""
    value, error = trends[:, 0], np.maximum(trends[:, 1], least_error)
    weight = 1.0 / error**2
    mean = float(np.sum(weight * value) / np.sum(weight))
    spread = np.sqrt(np.sum(weight * (value - mean) ** 2) / max(len(value) - 1, 1))
    return mean, float(max(spread, 1.0) / np.sqrt(np.sum(weight)))
