"""From unevenly spaced samples to an even grid, without inventing data.

Current is known between samples (backward hold), so its mean over each grid interval is exact and charge is kept.
Voltage and temperature are not known between samples: a grid point without a sample near it stays missing (NaN). Where
a log is slower than the grid, each sample is told at the grid point next to it, if the voltage hardly bends there.
Where a pause in the log leaves even the current unknown, the grid is cut and the parts are told apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.lost_samples import tick_s, with_lost_samples
from models.data.lost_temperature import without_temperature_s
from models.data.stretches import stretches
from models.data.timeseries import FloatArray, TimeSeries

# A pause in the log longer than this many typical intervals, with current on either side, is a gap.
_GAP_FACTOR = 30.0
_REST_FRACTION = 0.01
# More rows without a voltage than this are no accident.
_HELD_SHARE = 0.05
# Without a current for longer than so many steps of the grid, or usual intervals of the current: it is not known.
_LOST_FACTOR = 1.5
# Most that the voltage of a slow log may be off at the grid point next to a sample: as a converter resolves it.
_MOVED_V = 5e-4


@dataclass(frozen=True)
class GridRun:
    """One run on an even grid.

    Attributes
    ----------
    time_s : (n,) grid times, from the run's first sample on, step `dt_s`
    current_A : (n,) mean current over the interval that ends at each grid time
    voltage_V, temperature_degC : (n,) at the grid time; voltage NaN where no sample lies near
    charge_Ah : (n,) charge counted from the first sample (positive: charged)
    segment_starts : indices at which a part begins (0 is always one)
    measured : (n,) True where voltage is known
    without_temperature_s : longest time over which it was not logged while the voltage was
    n_missing : grid points without voltage
    current_known : (n,) False where the log has no current over the interval, and `current_A` is the last one before;
        None where it has one everywhere
    """

    name: str
    dt_s: float
    time_s: FloatArray
    current_A: FloatArray
    voltage_V: FloatArray
    temperature_degC: FloatArray
    ambient_degC: FloatArray | None
    charge_Ah: FloatArray
    soc_ref: FloatArray | None
    segment_starts: tuple[int, ...]
    measured: np.ndarray
    without_temperature_s: float = 0.0
    current_known: np.ndarray | None = None

    @property
    def logged_current_A(self) -> FloatArray:
        """(n,) the current, NaN where the log has none."""
        return self.current_A if self.current_known is None else np.where(self.current_known, self.current_A, np.nan)

    @property
    def n_missing(self) -> int:
        """Number of grid points without a voltage."""
        return int((~self.measured).sum())

    def __len__(self) -> int:
        """Return the number of grid points."""
        return len(self.time_s)


def typical_interval_s(runs: list[TimeSeries]) -> float:
    """Return the median sampling interval of several runs, in s, rounded to 1, 2 or 5 times a power of ten."""
    median = float(np.median(np.concatenate([_intervals_s(run) for run in runs])))
    scale = 10.0 ** np.floor(np.log10(median))
    return float(min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(np.log(m * scale / median))) * scale)


def _intervals_s(run: TimeSeries) -> FloatArray:
    """Intervals of a log; where samples were lost here and there, that of its clock as often as it should be there."""
    tick = tick_s(run.time_s)
    if tick is not None:
        return np.full(round(run.duration_s / tick), tick)
    step = np.diff(run.time_s)
    held = np.isnan(run.voltage_V[:-1]) & ~np.isnan(run.current_A[:-1])
    if held.sum() <= _HELD_SHARE * len(step):
        return step
    # A log that is written on change has such rows just before its changes (`stamps.on_change`): that near it looks.
    return np.full(len(step), np.quantile(step[held], 0.25))


def to_grid(run: TimeSeries, dt_s: float) -> GridRun:
    """Put a run on an even grid of step `dt_s`.

    Parameters
    ----------
    run : TimeSeries
    dt_s : grid step in s; the model's sampling time

    Returns
    -------
    GridRun
    """
    run = with_lost_samples(run)
    t = run.time_s - run.time_s[0]
    current = fill_hold(run.current_A)
    n = int(np.floor(t[-1] / dt_s + 1e-6)) + 1
    grid = np.arange(n) * dt_s
    charge_As = np.concatenate([[0.0], np.cumsum(current[1:] * np.diff(t))])
    charge_grid = np.interp(grid, t, charge_As)
    mean_current = np.empty(n)
    mean_current[1:] = np.diff(charge_grid) / dt_s
    mean_current[0] = current[0]
    voltage = _sample_near(grid, (t, run.voltage_V, current), mean_current, dt_s)
    voltage = _slowly_logged(voltage, grid, (t, run.voltage_V, current), dt_s)
    return GridRun(
        name=run.name,
        dt_s=dt_s,
        time_s=grid,
        current_A=mean_current,
        voltage_V=voltage,
        temperature_degC=_interpolate(grid, t, run.temperature_degC),
        ambient_degC=None if run.ambient_degC is None else _interpolate(grid, t, run.ambient_degC),
        charge_Ah=charge_grid / 3600.0,
        soc_ref=None if run.soc_ref is None else _reference(grid, t, run.soc_ref),
        segment_starts=_segments(grid, t, current),
        measured=~np.isnan(voltage),
        without_temperature_s=without_temperature_s(run),
        current_known=_current_known(grid, t, run.current_A, dt_s),
    )


def fill_hold(values: FloatArray) -> FloatArray:
    """Carry the last known value over missing ones (leading ones become 0: nothing flowed before the first value)."""
    known = ~np.isnan(values)
    if known.all():
        return values
    index = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.where(index >= 0, values[np.maximum(index, 0)], 0.0)


def _current_known(grid: FloatArray, t: FloatArray, current_A: FloatArray, dt_s: float) -> np.ndarray | None:
    """(n,) True where the current over a grid interval was logged; None where it was everywhere.

    A sample here and there without a current is none that was lost, and neither are those of a log that has currents
    less often than other values.
    """
    missing = np.isnan(current_A)
    if not missing.any():
        return None
    steps = np.diff(t[~missing])
    longest_s = _LOST_FACTOR * max(dt_s, float(np.median(steps)) if len(steps) else dt_s)
    interval_s, lost_s = np.diff(t, prepend=t[0]), np.zeros(len(t))
    for begin, end in stretches(missing):
        if t[end - 1] - t[max(begin - 1, 0)] > longest_s:
            lost_s[begin:end] = interval_s[begin:end]
    counted_s = np.interp(grid, t, np.cumsum(lost_s))
    known = np.diff(counted_s, prepend=counted_s[0]) <= 0.5 * dt_s
    known[0] = not (missing[0] and lost_s[1] > 0.0)
    return None if known.all() else known


def _reference(grid: FloatArray, t: FloatArray, values: FloatArray) -> FloatArray:
    """Linear interpolation between known values, and missing beyond them: a start that is known is no reference."""
    known = ~np.isnan(values)
    if not known.any():
        return np.full(len(grid), np.nan)
    return np.interp(grid, t[known], values[known], left=np.nan, right=np.nan)


def _interpolate(grid: FloatArray, t: FloatArray, values: FloatArray) -> FloatArray:
    """Linear interpolation over slowly varying values; all NaN where nothing is known."""
    known = ~np.isnan(values)
    if not known.any():
        return np.full(len(grid), np.nan)
    return np.interp(grid, t[known], values[known])


def _sample_near(
    grid: FloatArray, log: tuple[FloatArray, FloatArray, FloatArray], mean_current: FloatArray, dt_s: float
) -> FloatArray:
    """Interpolate between two samples at most 1.5 grid steps apart, or take a sample within 1 % of a step.

    Across a change of the current a straight line between two samples one step apart has as much of the later voltage
    as the grid's mean current has of the later current. Between others it has more or less: a model would be given
    the voltage of another current than that beside it. What is between the two is told by all changes of the log.
    """
    known = ~np.isnan(log[1])
    tk, vk, ik = (values[known] for values in log)
    if len(tk) == 0:
        return np.full(len(grid), np.nan)
    out = np.interp(grid, tk, vk)
    right = np.clip(np.searchsorted(tk, grid), 0, len(tk) - 1)
    left = np.clip(right - 1, 0, len(tk) - 1)
    near = np.minimum(np.abs(tk[right] - grid), np.abs(grid - tk[left])) <= 0.01 * dt_s
    bracketed = (tk[left] <= grid) & (grid <= tk[right]) & (tk[right] - tk[left] <= 1.5 * dt_s)
    # A log that has the same current on both sides may have a row of the step itself, with the voltage before it.
    step = ~near & (np.abs(ik[right] - ik[left]) > _REST_FRACTION * float(np.max(np.abs(ik))))
    out[step] += _at_once_Ohm(ik, vk) * (mean_current - np.interp(grid, tk, ik))[step]
    out[~(near | bracketed)] = np.nan
    return out


def _at_once_Ohm(current: FloatArray, voltage: FloatArray) -> float:
    """What changes of the current do to the voltage from one sample to the next."""
    change = np.diff(current)
    return float(change @ np.diff(voltage)) / max(float(change @ change), 1e-30)


def _slowly_logged(
    voltage: FloatArray, grid: FloatArray, log: tuple[FloatArray, FloatArray, FloatArray], dt_s: float
) -> FloatArray:
    """Tell each sample of a slow log at the grid point next to it, between two others under the same current.

    A parabola through the three tells how far a straight line is off; where that is more than a converter resolves, as
    after a step or at the knee of a discharge, nothing is told.
    """
    t, volts, current = log
    if len(t) < 3 or float(np.median(np.diff(t))) <= dt_s:
        return voltage
    near = np.round(t / dt_s).astype(np.int64)
    away = t - dt_s * near
    scale = _REST_FRACTION * max(float(np.max(np.abs(current))), 1e-9)
    out = voltage.copy()
    before, after = np.diff(t)[:-1], np.diff(t)[1:]
    slopes = np.diff(volts) / np.diff(t)
    bend = (slopes[1:] - slopes[:-1]) / (before + after)
    here = np.arange(1, len(t) - 1)
    alike = (np.abs(current[here + 1] - current[here]) <= scale) & (np.abs(current[here] - current[here - 1]) <= scale)
    moved = away[here]
    # A grid point before the sample lies in the interval that ends there.
    slope = np.where(moved > 0.0, slopes[:-1], slopes[1:])
    gap = np.where(moved > 0.0, before, after)
    off_V = np.abs(bend * moved) * (gap - np.abs(moved))
    with np.errstate(invalid="ignore"):
        told = alike & (np.abs(moved) < gap) & (off_V <= _MOVED_V) & (near[here] < len(grid))
    place = near[here[told]]
    open_places = np.isnan(out[place])
    out[place[open_places]] = (volts[here] - slope * moved)[told][open_places]
    return out


def _segments(grid: FloatArray, t: FloatArray, current: FloatArray) -> tuple[int, ...]:
    step = np.diff(t)
    typical = float(np.median(step))
    scale = max(float(np.max(np.abs(current))), 1e-9)
    loaded = (np.abs(current[:-1]) > _REST_FRACTION * scale) | (np.abs(current[1:]) > _REST_FRACTION * scale)
    gaps = np.flatnonzero((step > _GAP_FACTOR * max(typical, 1e-9)) & loaded)
    # A constant-current step that is logged sparsely is no gap: the current is the same on both sides.
    gaps = [g for g in gaps if abs(current[g + 1] - current[g]) > _REST_FRACTION * scale]
    starts = sorted({0, *(int(np.searchsorted(grid, t[g + 1])) for g in gaps)})
    return tuple(s for s in starts if s < len(grid))
