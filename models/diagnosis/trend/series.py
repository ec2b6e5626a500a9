"""What persists over a series of runs: the sets of changes as hidden states, each run as what one sees of them.

A capacity that is lost stays lost: evidence of neighbouring runs counts for each of them, and a single run that nothing
bears out does not change what is said of the cell. Each run has to bear out each change against the same prior odds, so
that none is said to begin earlier than runs ask for it. Forward-backward recursion after Rabiner, Proc. IEEE 77 (1989)
257.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.trend.settings import SETTINGS
from models.diagnosis.trend.weighing import CHANGES, EVERY, Chances


@dataclass(frozen=True)
class ChangePoint:
    """From which run on something has changed.

    Attributes
    ----------
    change : what
    first : number of the first run that shows it
    low, high : numbers of the runs between which it began, with 95 %
    probability : that it is there from `first` to the end
    """

    change: str
    first: int
    low: int
    high: int
    probability: float


def smoothed(runs: list[Chances]) -> FloatArray:
    """(n, sets) probability of each set of changes in each run, by all runs; sets in the order of `EVERY`."""
    seen, moves = _seen(runs), _moves()
    n = len(runs)
    forward, backward = np.empty((n, len(EVERY))), np.ones((n, len(EVERY)))
    state = np.ones(len(EVERY))
    for k in range(n):
        state = (state if k == 0 else state @ moves) * seen[k]
        state /= state.sum()
        forward[k] = state
    for k in range(n - 2, -1, -1):
        after = moves @ (seen[k + 1] * backward[k + 1])
        backward[k] = after / after.sum()
    both = forward * backward
    return both / both.sum(axis=1, keepdims=True)


def change_points(runs: list[Chances]) -> list[ChangePoint]:
    """Where each change that lasts to the end began."""
    by_set, out = smoothed(runs), []
    for change in CHANGES:
        there = by_set @ np.array([float(change in each) for each in EVERY])
        absent = np.flatnonzero(there < 0.5)
        first = int(absent[-1]) + 1 if len(absent) else 0
        if first == len(runs):
            continue
        # Runs in which it is neither surely absent nor surely there are those between which it began.
        low = np.flatnonzero(there < 0.025)
        high = np.flatnonzero(there < 0.975)
        out.append(
            ChangePoint(
                change,
                first,
                int(low[-1]) + 1 if len(low) else 0,
                max(first, min(int(high[-1]) + 1 if len(high) else 0, len(runs) - 1)),
                float(there[first:].min()),
            )
        )
    return sorted(out, key=lambda each: each.first)


def _moves() -> FloatArray:
    """(sets, sets) probability of each set after each."""
    at = SETTINGS
    out = np.ones((len(EVERY), len(EVERY)))
    for i, was in enumerate(EVERY):
        for j, now in enumerate(EVERY):
            for change in CHANGES:
                moved = at.ends if change in was else at.begins
                out[i, j] *= moved if (change in was) != (change in now) else 1.0 - moved
    return out


def _seen(runs: list[Chances]) -> FloatArray:
    """(n, sets) how much each run alone speaks for each set; what none of them stands for says nothing of them."""
    out = np.array([[each.nothing, *(each.of[one] for one in EVERY[1:])] for each in runs])
    return out + np.array([[each.unknown] for each in runs]) + 1e-300
