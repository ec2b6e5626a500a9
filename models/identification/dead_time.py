"""By how many samples the voltage comes after the current, told from its answer to steps of the current."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray

# Delays that are looked for, both ways: what is further off is no rig that samples in turns but a wrong clock.
_FURTHEST = 5
# The answer is told from so many samples before the voltage's to so many after it: slow parts of the cell's answer that
# were left out would be taken for an answer before the step.
_BEFORE, _AFTER = _FURTHEST + 2, 20
# A cell's voltage answers with the resistance of its electrolyte and contacts at once. What an answer explains of the
# voltage's changes is less by at most the first share where it begins too early or in time, and by more than the second
# where it begins a sample too late. Of measured records with steps: less than 0.02, and 0.65 to 0.99.
_IN_TIME, _TOO_LATE = 0.05, 0.2
# A delay is taken out where that leaves at most so much of what one answer in step leaves: half a sample stays.
_WORTH = 0.7
# Less of the voltage's changes than this explained, the answer is no answer.
_LEAST_SHARE = 0.2
_FEWEST_CHANGES = 100
# Of all that the current changes: keeps the equations solvable where it changes in one way only.
_RIDGE = 1e-10


@dataclass(frozen=True)
class DeadTime:
    """A delay that steps of the current show.

    Attributes
    ----------
    samples : by which the voltage comes after the current; negative: before
    before_V, after_V : RMS of what the changes of the voltage from sample to sample have that does not follow from the
        change of the current, at the same sample and at the delayed one
    """

    samples: int
    before_V: float
    after_V: float


def dead_time(grid: list[GridRun]) -> DeadTime | None:
    """Tell the delay that all runs with steps agree on.

    Parameters
    ----------
    grid : runs at one sampling time

    Returns
    -------
    DeadTime or None
        None where nothing can be told, or where the runs contradict each other. No delay is one of 0 samples.

    Notes
    -----
    Changes of the voltage are regressed on those of the current from a few samples before on. An answer that begins
    before the delay explains no more than one that begins there, one that begins later clearly less.
    """
    sums = [_Sums.of(run) for run in grid]
    told = [(delay, each) for each in sums if (delay := each.delay()) is not None]
    delays = {delay for delay, _ in told}
    if len(delays) != 1:
        return None
    (samples,) = delays
    together = reduce(add, (each for _, each in told))
    return DeadTime(samples, together.left_V(0), together.left_V(samples))


@dataclass(frozen=True)
class _Sums:
    """Sums of products of the changes of current and voltage: (lags, lags), (lags,), and of the voltage's own."""

    xx: FloatArray
    xy: FloatArray
    yy: float
    count: int

    @staticmethod
    def of(run: GridRun) -> _Sums:
        change_A, change_V = np.diff(run.current_A), np.diff(run.voltage_V)
        n = len(change_A) - _BEFORE - _AFTER
        if n < 1:
            return _Sums(np.zeros((0, 0)), np.zeros(0), 0.0, 0)
        # Column j: the current's change j - _BEFORE samples before the voltage's.
        x = np.column_stack([change_A[_BEFORE + _AFTER - j :][:n] for j in range(_BEFORE + _AFTER + 1)])
        y = change_V[_AFTER : _AFTER + n]
        seen = np.isfinite(y) & (np.abs(x).max(axis=1) > 0.0)
        x, y = x[seen], y[seen]
        return _Sums(x.T @ x, x.T @ y, float(y @ y), len(y))

    def delay(self) -> int | None:
        """Samples by which the answer comes late; None where it is not clear."""
        if self.count < _FEWEST_CHANGES:
            return None
        explained = np.array([self._explained(first) for first in range(_BEFORE + _FURTHEST + 2)])
        most = float(explained[0])
        if most < _LEAST_SHARE * self.yy:
            return None
        late = 1.0 - explained / most
        place = int(np.flatnonzero(late < _IN_TIME)[-1])
        samples = place - _BEFORE
        clear = abs(samples) <= _FURTHEST and late[place + 1] > _TOO_LATE
        worth = samples == 0 or self.left_V(samples) < _WORTH * self.left_V(0)
        return samples if clear and worth else None

    def _explained(self, first: int) -> float:
        """Sum of squares that an answer explains which begins at a lag."""
        xx, xy = self.xx[first:, first:], self.xy[first:]
        ridge = _RIDGE * float(np.trace(self.xx)) * np.eye(len(xy))
        return float(xy @ np.linalg.solve(xx + ridge, xy))

    def left_V(self, samples: int) -> float:
        """RMS of what an answer that comes all at once leaves of the voltage's changes."""
        place = samples + _BEFORE
        explained = self.xy[place] ** 2 / self.xx[place, place]
        return float(np.sqrt(max(self.yy - explained, 0.0) / self.count))

    def __add__(self, other: _Sums) -> _Sums:
        return _Sums(self.xx + other.xx, self.xy + other.xy, self.yy + other.yy, self.count + other.count)
