"""When a contact was bad: intervals of a record in which the error jumps with the current, by change points.

From one sample to the next a resistance that is there in state z = 1 and not in z = 0 changes the voltage by
r (z_k I_k - z_(k-1) I_(k-1)); all that is slow, and so most of a model's error, is gone from such differences. The
likeliest sequence of states for a resistance is found by dynamic programming (Viterbi, IEEE Trans. Inf. Theory 13,
1967), with a price for every change that chance alone would not pay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from models.data.stretches import stretches
from models.data.timeseries import FloatArray
from models.effects.view import View

# Samples that are looked at; more of a long record hardly move an end of an interval.
_SAMPLES = 8000
# Resistances that are tried, over the cell's own.
_TRIED = (0.12, 0.25, 0.5, 1.0, 2.0, 4.0)
# Standard deviations that nine cases of ten do better than.
_UNLUCKY = 1.28
# A change of the state costs more than one wild sample can bring at the most: a spike that comes and goes at once is no
# interval, and a model's errors at steps are not independent from one to the next. In units of the log likelihood.
_CHANGE, _WILD, _WORTH = 15.0, 20.0, 10.0
_SHORTEST = 5
# Resolution of a converter, V; steps of the current from which the model's own error at a step is told, over capacity.
_LEAST_V, _STEP_C_RATE = 2e-4, 0.1
_TO_STD = 1.4826
_REFINEMENTS = 2
# Of the model's own error at steps: bumps over the state of charge, the steps that it takes to tell them from a bad
# contact, and rounds of the fit.
_BUMPS, _ENOUGH_STEPS, _REWEIGHTED = 6, 100, 6


def bad_contact(view: View) -> np.ndarray:
    """(n,) whether the contact is bad, for every sample of the run; nowhere if it does not come and go.

    Parameters
    ----------
    view : run with the model's voltage; its samples do not matter
    """
    n, every = len(view.run), _looked_at(view)
    if len(every) <= 2 * _SHORTEST:
        return np.zeros(n, dtype=bool)
    state = _states(replace(view, index=every))
    return state[np.maximum(np.searchsorted(every, np.arange(n), side="right") - 1, 0)]


def smallest_found_Ohm(view: View, patterns: Sequence[np.ndarray]) -> float:
    """Smallest resistance whose intervals would be found nine times in ten, whichever they are; infinite: none would.

    Parameters
    ----------
    view : run with the model's voltage; its samples do not matter
    patterns : (n,) each, intervals that are asked about
    """
    every = _looked_at(view)
    if len(every) <= 2 * _SHORTEST:
        return np.inf
    view = replace(view, index=every)
    _, std_V = _moved(view)
    always = _always(view, np.diff(view.run.current_A[every])) / std_V[:, None]
    tried_Ohm = max(view.model.typical_Ohm, 1e-6) * np.array(_TRIED)
    largest = 0.0
    for bad in patterns:
        carried = np.diff(np.where(bad, view.run.current_A, 0.0)[every]) / std_V
        # What any step has, a contact that is bad for long is taken for in part.
        own = carried - always @ np.linalg.lstsq(always, carried, rcond=None)[0]
        changes = int(np.count_nonzero(np.diff(bad[every].astype(int))))
        inner, shown = float(carried @ carried), float(carried @ own)
        if changes < 2 or shown <= 0.0:
            return np.inf
        # With r where R is tried the log likelihood gains R (r shown - R inner / 2), with a std of R inner^0.5.
        gain = (_WORTH + _CHANGE * changes) / tried_Ohm + 0.5 * tried_Ohm * inner + _UNLUCKY * np.sqrt(inner)
        largest = max(largest, float(np.min(gain)) / shown)
    return largest


def _looked_at(view: View) -> np.ndarray:
    """Samples of a run that are looked at."""
    n = len(view.run)
    every = np.arange(0, n, max(1, -(-n // _SAMPLES)))
    return every[view.run.measured[every]]


def _moved(view: View) -> tuple[FloatArray, FloatArray]:
    """(m - 1,) by what the error moves from sample to sample beyond what it always does, and its std."""
    current_A = view.run.current_A[view.index]
    moved_V, moved_A = np.diff(view.residual_V), np.diff(current_A)
    moved_V = moved_V - _always_V(_always(view, moved_A), moved_V)
    stepped = np.abs(moved_A) > _STEP_C_RATE * view.capacity_Ah
    noise_V = max(_spread(moved_V[~stepped]), _LEAST_V)
    return moved_V, np.hypot(noise_V, _spread(moved_V[stepped] / moved_A[stepped]) * moved_A)


def _states(view: View) -> np.ndarray:
    """(m,) states of the likeliest resistance at the view's samples."""
    current_A = view.run.current_A[view.index]
    moved_V, std_V = _moved(view)
    typical_Ohm = max(view.model.typical_Ohm, 1e-6)
    tried = [sign * share * typical_Ohm for share in _TRIED for sign in (1.0, -1.0)]
    gain, state, ohm = max((_likeliest(moved_V, current_A, std_V, each) for each in tried), key=lambda each: each[0])
    for _ in range(_REFINEMENTS):
        closer = _resistance(moved_V, current_A, std_V, state, ohm)
        gain, state, ohm = max((gain, state, ohm), _likeliest(moved_V, current_A, std_V, closer), key=lambda e: e[0])
    state = _without_short(state)
    comes_and_goes = np.count_nonzero(np.diff(state)) >= 2
    if gain < _WORTH or not comes_and_goes:
        return np.zeros(len(current_A), dtype=bool)
    # What is bad is the state with the higher resistance.
    return state if ohm > 0.0 else ~state


def _always(view: View, moved_A: FloatArray) -> FloatArray:
    """(m - 1, k) shapes of what the model is off by at steps of the current, over the state of charge and current."""
    columns = moved_A[:, None]
    if np.count_nonzero(np.abs(moved_A) > _STEP_C_RATE * view.capacity_Ah) >= _ENOUGH_STEPS:
        current_A = view.run.current_A[view.index]
        columns = np.column_stack([view.bumps(_BUMPS)[1:] * columns, np.diff(current_A * np.abs(current_A))])
    return columns / (np.sqrt((columns**2).mean(axis=0)) + 1e-12)


def _always_V(columns: FloatArray, moved_V: FloatArray) -> FloatArray:
    """(m - 1,) what the model is off by at any step.

    Wild samples, and those of a bad contact, count as little as in a mean of absolute values.
    """
    always_V = np.zeros(len(moved_V))
    for _ in range(_REWEIGHTED):
        left_V = np.abs(moved_V - always_V)
        weight = 1.0 / np.maximum(left_V, max(float(np.median(left_V)), _LEAST_V))
        inner = (columns * weight[:, None]).T @ columns
        inner += 1e-6 * np.eye(len(inner)) * max(float(np.trace(inner)) / len(inner), 1e-12)
        always_V = columns @ np.linalg.solve(inner, columns.T @ (weight * moved_V))
    return always_V


def _spread(values: FloatArray) -> float:
    """Standard deviation about zero, whatever a few wild ones say; 0 of none."""
    return _TO_STD * float(np.median(np.abs(values))) if len(values) else 0.0


def _likeliest(
    moved_V: FloatArray, current_A: FloatArray, std_V: FloatArray, ohm: float
) -> tuple[float, np.ndarray, float]:
    """What a resistance that comes and goes brings in the log likelihood, its (n,) states, and it."""
    before_V, after_V = ohm * current_A[:-1], ohm * current_A[1:]

    def cost(change_V: FloatArray | float) -> FloatArray:
        return np.minimum(0.5 * ((moved_V - change_V) / std_V) ** 2, _WILD)

    good = cost(0.0)
    stay, come, go = (cost(each) - good for each in (after_V - before_V, after_V, -before_V))
    state, least = _path(stay.tolist(), (come + _CHANGE).tolist(), (go + _CHANGE).tolist())
    return -least, state, ohm


def _path(stay: list[float], come: list[float], go: list[float]) -> tuple[np.ndarray, float]:
    """(n,) states of the cheapest sequence, and its cost; a good contact that stays good costs nothing."""
    good, bad = 0.0, 0.0
    from_good, from_bad = [], []
    for kept, came, went in zip(stay, come, go, strict=True):
        to_bad, to_good = bad + kept > good + came, bad + went < good
        from_good.append(to_bad)
        from_bad.append(to_good)
        good, bad = (bad + went if to_good else good), (good + came if to_bad else bad + kept)
    state = np.zeros(len(stay) + 1, dtype=bool)
    state[-1] = bad < good
    for k in range(len(stay) - 1, -1, -1):
        state[k] = not from_good[k] if state[k + 1] else from_bad[k]
    return state, min(good, bad)


def _resistance(moved_V: FloatArray, current_A: FloatArray, std_V: FloatArray, state: np.ndarray, ohm: float) -> float:
    """The resistance that fits best with given states, wild samples left aside."""
    carried_A = np.diff(np.where(state, current_A, 0.0))
    tame = np.abs(moved_V - ohm * carried_A) < np.sqrt(2.0 * _WILD) * std_V
    weight = np.where(tame, carried_A / std_V**2, 0.0)
    inner = float(weight @ carried_A)
    return float(weight @ moved_V) / inner if inner > 0.0 else ohm


def _without_short(state: np.ndarray) -> np.ndarray:
    """The states without intervals of a few samples."""
    out = np.zeros(len(state), dtype=bool)
    for first, last in stretches(state):
        if last - first >= _SHORTEST:
            out[first:last] = True
    return out
