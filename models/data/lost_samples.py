"""Samples that a logger lost here and there, put back without a voltage and with the likeliest current.

A log on an even clock from which samples are missing at random says of the current in between only what its neighbours
say. Taken to hold backward, as it does in a log that is sparse on purpose, each lost sample would move a change of the
current to an earlier time; the mean of the neighbours halves the error of the counted charge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray, TimeSeries

# A clock's tick is an interval that this share of the log has, and of which nearly all intervals are whole multiples.
_TICK_SHARE, _WHOLE_SHARE, _WHOLE_WITHIN = 0.1, 0.9, 0.25
# Longer intervals than this many ticks are pauses or sparse logging, no lost samples: losing every second sample at
# random leaves one interval in 30 000 that is longer.
_LONGEST = 15.0
# More than three samples of four are not lost by chance: that is another pace.
_LONGEST_USUAL = 3.5
# Intervals of random losses do not follow from the one before; those of a logger that changes its pace come in blocks.
_INDEPENDENT = 0.3
# A logger that skips a beat now and then moves the charge by nothing that counts.
_LEAST_SHARE = 0.05


@dataclass(frozen=True)
class LostSpan:
    """Samples that are missing in a row: places of their neighbours in the run with all samples put back."""

    before: int
    after: int

    @property
    def lost(self) -> int:
        """How many are missing."""
        return self.after - self.before - 1


def tick_s(time_s: FloatArray) -> float | None:
    """Interval of an even clock from which samples are missing here and there; None where the log is no such one.

    Also None where nothing is missing, or where samples are missing in blocks.
    """
    step = np.diff(time_s)
    if len(step) < 10:
        return None
    shortest = step[step <= 1.5 * np.quantile(step, _TICK_SHARE)]
    tick = float(np.median(shortest))
    ticks = step / tick
    short = ticks < _LONGEST + 0.5
    whole = np.abs(ticks - np.round(ticks)) <= _WHOLE_WITHIN
    if np.median(ticks) > _LONGEST_USUAL:
        return None
    if whole[short].mean() < _WHOLE_SHARE or not short.mean() > 1.0 - _TICK_SHARE:
        return None
    more = (ticks > 1.5).astype(np.float64)
    if not _LEAST_SHARE < more.mean() < 1.0 - _TICK_SHARE:
        return None
    following = float(np.corrcoef(more[1:], more[:-1])[0, 1])
    return tick if abs(following) < _INDEPENDENT else None


def with_lost_samples(run: TimeSeries) -> TimeSeries:
    """Put samples that were lost at random back: current between its neighbours, nothing else known.

    A run of which none are missing, or whose intervals are long on purpose, is given back as it is.
    """
    tick = tick_s(run.time_s)
    if tick is None:
        return run
    lost = _lost(run.time_s, tick)
    before = np.repeat(np.arange(len(lost)), lost)
    number = np.arange(len(before)) - np.repeat(np.cumsum(lost) - lost, lost) + 1
    share = number / (lost[before] + 1.0)
    at = before + 1

    def between(values: FloatArray) -> FloatArray:
        return (1.0 - share) * values[before] + share * values[at]

    def put(values: FloatArray | None, inserted: FloatArray) -> FloatArray | None:
        return None if values is None else np.insert(values, at, inserted)

    nothing = np.full(len(at), np.nan)
    known = {name: put(getattr(run, name), between(getattr(run, name))) for name in ("time_s", "current_A")}
    unknown = {
        name: put(getattr(run, name), nothing) for name in ("voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
    }
    return replace(run, **known, **unknown)


def lost_spans(run: TimeSeries) -> list[LostSpan]:
    """Where samples are missing, in the run that `with_lost_samples` makes of this one."""
    tick = tick_s(run.time_s)
    if tick is None:
        return []
    lost = _lost(run.time_s, tick)
    place = np.arange(len(lost)) + np.cumsum(lost) - lost
    return [LostSpan(int(k), int(k + n + 1)) for k, n in zip(place[lost > 0], lost[lost > 0], strict=True)]


def _lost(time_s: FloatArray, tick: float) -> np.ndarray:
    """(n - 1,) samples that are missing in each interval."""
    ticks = np.round(np.diff(time_s) / tick)
    return np.where((ticks > 1.5) & (ticks <= _LONGEST), ticks - 1.0, 0.0).astype(np.int64)
