"""Rests that somebody has cut out of a log.

Where the time was kept, a gap under load is left behind, over which the current of either side would be taken to have
flowed; where it was counted anew, nothing is left but a voltage that jumps away from where the load had it. Either way
the cell has relaxed, and no charge has moved. What tells a rest from a load that was merely not logged is the voltage:
over a rest it comes back against the current before, over a load it goes on with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.lost_samples import tick_s
from models.data.timeseries import FloatArray, TimeSeries

# Of the largest current: what is no rest, and what is a change.
_LOADED, _CHANGE = 0.02, 0.05
# A gap is so many typical intervals long; where samples are lost at random, more than are lost in a row by chance.
_GAP, _LOST = 3.0, 15.0
# Scatter of a voltage step at an even load, in so many of which it is none of it, and the least that counts.
_CERTAIN, _LEAST_V = 8.0, 2e-3
_SIGMA_OF_MAD = 1.48
# A rest that left no gap shows only where the current was even for so many samples on either side: elsewhere a voltage
# that moves is one that answers. It stands out from its neighbours by this factor, and is no small thing.
_EVEN, _STANDS_OUT, _LEAST_JUMP_V = 10, 4.0, 5e-3
# Gaps that are judged together: the mean of what came back is certain at so many standard errors.
_TOGETHER, _FEWEST = 4.0, 5
# A filter leaves a few samples at rest behind, such as those in which a current changed.
_RARELY = 0.99
# A rest of unknown length is taken to have been as long as the voltage takes to go back where it was (what relaxes in a
# time builds up again in about the same), within these bounds.
_SHORTEST_S, _LONGEST_S, _GONE_BACK = 60.0, 3600.0, 0.8


@dataclass(frozen=True)
class CutRests:
    """A log with its rests back in place.

    Attributes
    ----------
    run : with a row without voltage for each rest
    kept_s : length of each rest whose time was kept
    guessed_s : estimated length of each rest that was cut out of the time as well
    """

    run: TimeSeries
    kept_s: tuple[float, ...] = ()
    guessed_s: tuple[float, ...] = ()


def with_cut_rests(run: TimeSeries) -> CutRests:
    """Put rests that were cut out back; a run without any is given back as it is."""
    step = np.diff(run.time_s)
    largest = float(np.nanmax(np.abs(run.current_A), initial=0.0))
    if len(step) < 10 or largest <= 0.0 or np.isnan(run.current_A).any():
        return CutRests(run)
    usual_s = float(np.median(step))
    came_back_V, sigma_V = _came_back_V(run, step, usual_s, largest)
    loaded = (np.abs(run.current_A[:-1]) > _LOADED * largest) & (np.abs(run.current_A[1:]) > _LOADED * largest)
    gap_s = _GAP * usual_s if tick_s(run.time_s) is None else _LOST * usual_s
    at_gap = np.flatnonzero(loaded & (step > gap_s) & np.isfinite(came_back_V))
    rests = [int(k) for k in at_gap if came_back_V[k] > max(_CERTAIN * sigma_V, _LEAST_V)]
    if len(at_gap) >= _FEWEST:
        # Where a resistance changes with charge, single gaps are not certain; all of them together are.
        back_V = came_back_V[at_gap]
        together = back_V.mean() > _TOGETHER * back_V.std() / np.sqrt(len(back_V))
        if 2 * len(rests) >= len(at_gap) or (together and _never_rests(run, largest)):
            rests = [int(k) for k in at_gap]
    if rests:
        # What began as a rest that is known to have been cut goes on as one.
        begun = (np.abs(run.current_A[:-1]) <= _LOADED * largest) & (np.abs(run.current_A[1:]) > _LOADED * largest)
        rests = sorted({*rests, *(int(k) for k in np.flatnonzero(begun & (step > gap_s)))})
    jumps = loaded & (step <= _GAP * usual_s) & (came_back_V > max(_CERTAIN * sigma_V, _LEAST_JUMP_V))
    guesses = {
        int(k): _guessed_s(run, int(k), float(came_back_V[k]))
        for k in np.flatnonzero(jumps)
        if _is_alone(run, int(k), largest)
    }
    if not rests and not guesses:
        return CutRests(run)
    lengths = {k: 0.0 for k in rests} | guesses
    kept = tuple(float(step[k] - usual_s) for k in rests)
    return CutRests(_with_rests(run, lengths, usual_s), kept, tuple(guesses[k] for k in sorted(guesses)))


def _never_rests(run: TimeSeries, largest: float) -> bool:
    """Whether no sample is at rest between the first load and the last."""
    loaded = np.flatnonzero(np.abs(run.current_A) > _LOADED * largest)
    return bool(len(loaded) > _RARELY * (loaded[-1] - loaded[0] + 1))


def _is_alone(run: TimeSeries, k: int, largest: float) -> bool:
    """Whether the current is even before and after samples `k` and `k` + 1, and the voltage but for that step."""
    first, last = k - _EVEN + 1, k + 1 + _EVEN
    if first < 0 or last > len(run):
        return False
    if np.ptp(run.current_A[first:last]) > _CHANGE * largest:
        return False
    moved_V = np.abs(np.diff(run.voltage_V[first:last]))
    others = np.delete(moved_V, _EVEN - 1)
    return bool(moved_V[_EVEN - 1] > _STANDS_OUT * np.max(others))


def _came_back_V(run: TimeSeries, step: FloatArray, usual_s: float, largest: float) -> tuple[FloatArray, float]:
    """(n - 1,) how far the voltage went against the current before, less the ohmic answer; and its usual scatter."""
    moved_A, moved_V = np.diff(run.current_A), np.diff(run.voltage_V)
    usual = (step <= 1.5 * usual_s) & np.isfinite(moved_V)
    edge = usual & (np.abs(moved_A) > _CHANGE * largest)
    ohmic = float(np.median(moved_V[edge] / moved_A[edge])) if edge.sum() >= _FEWEST else 0.0
    left_V = moved_V - ohmic * moved_A
    even = usual & ~edge
    scatter = np.abs(left_V[even] - np.median(left_V[even])) if even.any() else np.zeros(1)
    return -np.sign(run.current_A[:-1]) * left_V, _SIGMA_OF_MAD * float(np.median(scatter))


def _guessed_s(run: TimeSeries, k: int, came_back_V: float) -> float:
    """How long a rest between samples `k` and `k` + 1 may have been."""
    direction = np.sign(run.current_A[k])
    gone_V = direction * (run.voltage_V[k + 1 :] - run.voltage_V[k + 1])
    back = np.flatnonzero(gone_V >= _GONE_BACK * came_back_V)
    took_s = float(run.time_s[k + 1 + int(back[0])] - run.time_s[k + 1]) if len(back) else _LONGEST_S
    return float(np.clip(took_s, _SHORTEST_S, _LONGEST_S))


def _with_rests(run: TimeSeries, more_s: dict[int, float], usual_s: float) -> TimeSeries:
    """Two rows at rest between each of these samples and the next, which comes later by so much."""
    after = np.array(sorted(more_s)) + 1
    later = np.zeros(len(run))
    for k, more in more_s.items():
        later[k + 1 :] += more
    time_s = run.time_s + later
    least_s = np.minimum(usual_s, (time_s[after] - time_s[after - 1]) / 3.0)
    within_s = np.column_stack([time_s[after - 1] + least_s, time_s[after] - least_s]).ravel()
    after = np.repeat(after, 2)

    def put(values: FloatArray | None, inserted: FloatArray) -> FloatArray | None:
        return None if values is None else np.insert(values, after, inserted)

    nothing = np.full(len(after), np.nan)
    rows = {
        name: put(getattr(run, name), nothing) for name in ("voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
    }
    times, currents = put(time_s, within_s), put(run.current_A, np.zeros(len(after)))
    return replace(run, time_s=times, current_A=currents, **rows)
