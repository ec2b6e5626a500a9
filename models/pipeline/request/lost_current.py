"""What flowed while a logger lost samples, told by the voltage after them.

Where the current changed while samples were lost, nobody wrote down when. Half of the samples dropped at random leave
the charge of each change open by half a sample and more; over some hundred changes these errors add up, as a random
walk, to a tenth of a percent of the capacity, which bends the curve of a model, and what relaxes after a change is
taken for something else. But the relaxation tells when the current changed: a later start leaves more of it. A first
model says how the voltage answers; each change is put where it explains the next samples best, and the model is fitted
again, for as long as that lowers its error on samples that it did not see.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from models.comparison.start import Start, free_run_from_V
from models.data.lost_samples import LostSpan, lost_spans, with_lost_samples
from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.plans import Built
from models.pipeline.training import Training

# A relaxation is looked at for so many samples after a gap, and the error from before it for half as many.
_WINDOW = 60
# Gaps are tried in so many groups: what the one before did has mostly faded when the next of its group comes.
_GROUPS = 8
# A change that is smaller than this share of the largest current is none.
_CHANGED = 0.01
# Without a change a pulse may have been lost as a whole; of fewer samples than this it would have moved little.
_PULSE = 3
# An answer that is so many standard deviations from every place in the gap is no single change: a whole pulse was lost,
# and its charge is what the voltage says, as far as the run's currents reach.
_ELSEWHERE = 5.0
_ROUNDS = 5


@dataclass(frozen=True)
class _Gaps:
    """A run with its lost samples put back, and the gaps in which the current may have been another.

    Attributes
    ----------
    series : the run
    spans : (G,) gaps
    before_A, after_A : (G,) current on either side
    lost : (G,) samples that are missing
    changes : places at which the current changes
    """

    series: TimeSeries
    spans: list[LostSpan]
    before_A: FloatArray
    after_A: FloatArray
    lost: np.ndarray
    changes: np.ndarray

    @property
    def largest_A(self) -> float:
        """Largest current of the run."""
        return float(np.abs(self.series.current_A).max())

    def with_mean(self, mean_A: FloatArray) -> TimeSeries:
        """The run with a mean current over each gap: one change where there is a place for it, else even."""
        current = self.series.current_A.copy()
        for number, (span, mean) in enumerate(zip(self.spans, mean_A.tolist(), strict=True)):
            before, after, lost = self.before_A[number], self.after_A[number], span.lost
            values = np.full(lost, mean)
            if before != after and 0.0 <= (mean - after) / (before - after) <= 1.0:
                held = lost * (mean - after) / (before - after)
                values = after + np.clip(held - np.arange(lost), 0.0, 1.0) * (before - after)
            current[span.before + 1 : span.after] = values
        return replace(self.series, current_A=current)


def with_lost_currents(
    data: Training,
    built: Built,
    build: Callable[[Training], Built],
) -> tuple[Training, Built]:
    """Find what flowed while samples were lost, and fit again.

    Parameters
    ----------
    data : training runs with the neighbours' mean where samples were lost
    built : what was fitted to them
    build : fits the same choices to other currents

    Returns
    -------
    data, built
        As they were where no run has lost samples, or the voltage does not tell.
    """
    gaps = [_gaps_of(run) for run in data.runs]
    if not any(each.spans for each in gaps):
        return data, built
    mean_A = [0.5 * (each.before_A + each.after_A) for each in gaps]
    error_V = built.held_out().rmse_V
    for _ in range(_ROUNDS):
        mean_A = [
            _told_A(built.network, each, now, start, data.dt_s) if each.spans else now
            for each, now, start in zip(gaps, mean_A, data.starts, strict=True)
        ]
        grid = [
            to_grid(each.with_mean(now), data.dt_s) if each.spans else run
            for each, now, run in zip(gaps, mean_A, data.grid, strict=True)
        ]
        trial = replace(data, grid=grid, fit_grid=grid)
        again = build(trial)
        found_V = again.held_out().rmse_V
        if found_V >= error_V:
            break
        data, built, error_V = trial, again, found_V
    return data, built


def _gaps_of(run: TimeSeries) -> _Gaps:
    series = with_lost_samples(run)
    current = series.current_A
    least_A = _CHANGED * float(np.nanmax(np.abs(current)))
    spans = [
        each
        for each in lost_spans(run)
        if abs(current[each.after] - current[each.before]) > least_A or each.lost >= _PULSE
    ]
    before_A, after_A = (
        np.array([current[place] for place in places])
        for places in ([each.before for each in spans], [each.after for each in spans])
    )
    changes = np.flatnonzero(np.abs(np.diff(current)) > least_A) + 1
    return _Gaps(series, spans, before_A, after_A, np.array([each.lost for each in spans]), changes)


def _told_A(network: LocalModelNetwork, gaps: _Gaps, mean_A: FloatArray, start: Start, dt_s: float) -> FloatArray:
    """(G,) mean current over each gap, as far as the voltage after it tells."""
    run = to_grid(gaps.with_mean(mean_A), dt_s)
    simulated_V = free_run_from_V(network, run, start)
    error_V = run.voltage_V - simulated_V
    noise_V = 1.4826 * float(np.nanmedian(np.abs(error_V - np.nanmedian(error_V))))
    moved_A = _moved_A(gaps, mean_A)
    out = mean_A.copy()
    for group in range(_GROUPS):
        own = np.arange(group, len(mean_A), _GROUPS)
        trial = mean_A.copy()
        trial[own] += moved_A[own]
        answer_V = free_run_from_V(network, to_grid(gaps.with_mean(trial), dt_s), start) - simulated_V
        for place in own.tolist():
            found = _one(run, gaps, place, (error_V, answer_V / moved_A[place]), noise_V)
            if found is not None:
                out[place] = _place_A(gaps, place, mean_A[place] + found[0], found[1])
    return out


def _moved_A(gaps: _Gaps, mean_A: FloatArray) -> FloatArray:
    """(G,) by how much a mean current is moved to see what the voltage answers: a change by half a sample at most."""
    apart = gaps.before_A - gaps.after_A
    changed = np.abs(apart) > _CHANGED * gaps.largest_A
    half = 0.5 * apart / gaps.lost
    inside = np.abs(mean_A + half - gaps.after_A) <= np.abs(apart)
    return np.where(changed, np.where(inside, half, -half), 0.1 * gaps.largest_A)


def _one(
    run: GridRun, gaps: _Gaps, place: int, signals: tuple[FloatArray, FloatArray], noise_V: float
) -> tuple[float, float] | None:
    """By how many A a mean current should be more, with its standard deviation; None where nothing tells."""
    error_V, answer_V = signals
    before, index = _window(run, gaps, place)
    index = index[np.isfinite(error_V[index])]
    late = index > before
    if not late.any() or late.all() or len(index) < 4:
        return None
    rows = np.column_stack([np.ones(len(index)), np.where(late, answer_V[index] - answer_V[before], 0.0)])
    centred = rows[:, 1] - rows[:, 1].mean()
    information = float(centred @ centred)
    if information <= 1e-12 * float(rows[:, 1] @ rows[:, 1]):
        return None
    more_A = float(centred @ error_V[index]) / information
    left_V = error_V[index] - error_V[index].mean() - more_A * centred
    variance = max(noise_V**2, float(left_V @ left_V) / (len(index) - 2)) / information
    return more_A, float(np.sqrt(variance))


def _window(run: GridRun, gaps: _Gaps, place: int) -> tuple[int, np.ndarray]:
    """Last grid point before a gap, and those on either side of it up to the next change of the current."""
    span, at = gaps.spans[place], gaps.series.time_s - gaps.series.time_s[0]
    before, after = np.searchsorted(run.time_s, [at[span.before], at[span.after] - 1e-6], side="left").tolist()
    earlier, later = np.searchsorted(gaps.changes, [span.before, span.after], side="right").tolist()
    first = at[gaps.changes[earlier - 1]] if earlier > 0 else 0.0
    last = at[gaps.changes[later]] if later < len(gaps.changes) else np.inf
    begin, end = np.searchsorted(run.time_s, [first, last]).tolist()
    index = np.arange(max(begin, before - _WINDOW // 2), min(end, after + _WINDOW))
    return before, index[(index <= before) | (index >= after)]


def _place_A(gaps: _Gaps, place: int, told_A: float, std_A: float) -> float:
    """Mean current over a gap: the mean over all samples at which it may have changed."""
    before_A, after_A, lost = gaps.before_A[place], gaps.after_A[place], gaps.lost[place]
    possible = after_A + np.arange(lost + 1) / lost * (before_A - after_A)
    distance = (told_A - possible) / max(std_A, 1e-12)
    beyond = not min(before_A, after_A) <= told_A <= max(before_A, after_A)
    if beyond and np.abs(distance).min() > _ELSEWHERE:
        return float(np.clip(told_A, gaps.series.current_A.min(), gaps.series.current_A.max()))
    weight = np.exp(-0.5 * (distance**2 - np.min(distance**2)))
    return float(weight @ possible / weight.sum())
