"""When a contact was bad: intervals of a record in which the error jumps with the current, by change points.

From one sample to the next a resistance that is there in state z = 1 and not in z = 0 changes the voltage by
r (z_k I_k - z_(k-1) I_(k-1)); all that is slow, and so most of a model's error, is gone from such differences. The
likeliest sequence of states for a resistance is found by dynamic programming (Viterbi, IEEE Trans. Inf. Theory 13,
1967), with a price for every change that chance alone would not pay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.view import View

# Samples that are looked at; more of a long record hardly move an end of an interval.
_SAMPLES = 8000
# Resistances that are tried, over the cell's own.
_TRIED = (0.12, 0.25, 0.5, 1.0, 2.0, 4.0)
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
    n = len(view.run)
    every = np.arange(0, n, max(1, -(-n // _SAMPLES)))
    every = every[view.run.measured[every]]
    if len(every) <= 2 * _SHORTEST:
        return np.zeros(n, dtype=bool)
    state = _states(replace(view, index=every))
    return state[np.maximum(np.searchsorted(every, np.arange(n), side="right") - 1, 0)]


def _states(view: View) -> np.ndarray:
    """(m,) states of the likeliest resistance at the view's samples."""
    current_A = view.run.current_A[view.index]
    moved_V, moved_A = np.diff(view.residual_V), np.diff(current_A)
    moved_V = moved_V - _always_V(view, moved_V, moved_A)
    stepped = np.abs(moved_A) > _STEP_C_RATE * view.capacity_Ah
    noise_V = max(_spread(moved_V[~stepped]), _LEAST_V)
    std_V = np.hypot(noise_V, _spread(moved_V[stepped] / moved_A[stepped]) * moved_A)
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


def _always_V(view: View, moved_V: FloatArray, moved_A: FloatArray) -> FloatArray:
    """(m - 1,) what the model is off by at steps of the current over the state of charge, and for large currents.

    Wild samples, and those of a bad contact, count as little as in a mean of absolute values.
    """
    columns = moved_A[:, None]
    if np.count_nonzero(np.abs(moved_A) > _STEP_C_RATE * view.capacity_Ah) >= _ENOUGH_STEPS:
        current_A = view.run.current_A[view.index]
        columns = np.column_stack([view.bumps(_BUMPS)[1:] * columns, np.diff(current_A * np.abs(current_A))])
    size = np.sqrt((columns**2).mean(axis=0)) + 1e-12
    columns, always_V = columns / size, np.zeros(len(moved_V))
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
    edges = np.flatnonzero(np.diff(np.concatenate([[False], state, [False]])))
    out = np.zeros(len(state), dtype=bool)
    for first, last in edges.reshape(-1, 2):
        if last - first >= _SHORTEST:
            out[first:last] = True
    return out
