"""What persists over a series of runs: the sets of changes as hidden states, each run as what one sees of them.

A capacity that is lost stays lost: evidence of neighbouring runs counts for each of them, and a single run that nothing
bears out does not change what is said of the cell. Each run has to bear out each change against the same prior odds, so
that none is said to begin earlier than runs ask for it. Forward-backward recursion after Rabiner, Proc. IEEE 77 (1989)
257.

A charge and the discharge beside it saw the cell in one state. Alone, either can take a larger resistance for a moved
curve: both are voltages along one way. Together they cannot, since what a resistance loses turns with the current, and
the curve does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.trend.loss.losses import WAYS
from models.diagnosis.trend.settings import SETTINGS
from models.diagnosis.trend.weights.sizes import CAPACITY, CHANGES, EVERY, Changes
from models.diagnosis.trend.weights.weighing import Chances
from models.effects.half_cells import half_cells

# However unlikely one run makes a way, over its prior, others may bring it back.
_LEAST = 1e-3
# A run that moves less than this share of the capacity sees little of the curve.
_MOVES = 0.3
# Runs further apart than one place, and than this share of the whole life, may have seen the cell in two states.
_NEAR = 0.02


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

    def in_runs(self, groups: list[tuple[int, ...]]) -> ChangePoint:
        """The same by the numbers of runs, where what has been numbered are groups of them."""
        return replace(self, first=groups[self.first][0], low=groups[self.low][0], high=groups[self.high][0])


def together(cell: KnownCell, at: FloatArray, moved_Ah: FloatArray) -> list[tuple[int, ...]]:
    """Numbers of the runs that are weighed with each other, in the order of the series; parameters as of `cycles`.

    Charge and discharge only where half-cell curves make that of the cell, by which a loss bends the curve in a way
    that is known: else what both show alike of it would be told as a change beside the loss.
    """
    electrodes = half_cells(cell)
    if electrodes is None or not electrodes.published:
        return [(k,) for k in range(len(at))]
    return cycles(at, moved_Ah, cell.capacity_Ah)


def cycles(at: FloatArray, moved_Ah: FloatArray, capacity_Ah: float) -> list[tuple[int, ...]]:
    """Numbers of the runs of each cycle in the order of the series: two that follow each other, or one.

    Parameters
    ----------
    at : (n,) place of each run, never falling
    moved_Ah : (n,) charge that each has moved, positive where it charges
    capacity_Ah : of the cell
    """
    apart = np.diff(at)
    far = max(1.0, _NEAR * float(at[-1] - at[0]))
    moves = np.abs(moved_Ah) >= _MOVES * capacity_Ah
    both_ways = moves[:-1] & moves[1:] & (moved_Ah[:-1] * moved_Ah[1:] < 0.0) & (apart <= far)
    taken, pairs = np.zeros(len(at), dtype=bool), np.zeros(len(at), dtype=bool)
    for first in sorted(np.flatnonzero(both_ways).tolist(), key=lambda k: (apart[k], k)):
        if not taken[first : first + 2].any():
            taken[first : first + 2] = pairs[first] = True
    seconds = np.append(False, pairs[:-1])
    return [(k, k + 1) if pairs[k] else (k,) for k in range(len(at)) if not seconds[k]]


def agreed(several: list[Chances]) -> Chances:
    """What runs that were weighed with each other say together: the geometric mean of what each says.

    Both have seen the same samples, but each knows its own start and errors better than those of the other.
    """
    if len(several) == 1:
        return several[0]

    def mean(values: list[float]) -> float:
        return float(np.exp(np.mean(np.log(np.maximum(values, 1e-300)))))

    of = {each: mean([one.of[each] for one in several]) for each in several[0].of}
    nothing, unknown = (mean([getattr(one, name) for one in several]) for name in ("nothing", "unknown"))
    whole = nothing + unknown + sum(of.values())
    ways = [one.way for one in several if one.way]
    way = {k: mean([each.get(k, 0.0) for each in ways]) for k in sorted({k for each in ways for k in each})}
    return Chances(
        nothing / whole,
        unknown / whole,
        {each: p / whole for each, p in of.items()},
        {k: p / sum(way.values()) for k, p in way.items()},
    )


def smoothed(runs: list[Chances]) -> FloatArray:
    """(n, sets) probability of each set of changes in each run, by all runs; sets in the order of `EVERY`."""
    return _passed(_seen(runs), _moves(), np.ones(len(EVERY)))


def _passed(seen: FloatArray, moves: FloatArray, before: FloatArray) -> FloatArray:
    """(n, k) probability of each of k hidden states in each run, by what is seen of each, and how they follow."""
    n = len(seen)
    forward, backward = np.empty(seen.shape), np.ones(seen.shape)
    state = before
    for k in range(n):
        state = (state if k == 0 else state @ moves) * seen[k]
        state /= state.sum()
        forward[k] = state
    for k in range(n - 2, -1, -1):
        after = moves @ (seen[k + 1] * backward[k + 1])
        backward[k] = after / after.sum()
    both = forward * backward
    return both / both.sum(axis=1, keepdims=True)


def ways_of(runs: list[Chances], by_set: FloatArray) -> FloatArray:
    """(n, ways + 1) probability of each way to lose the capacity that is lost, by all runs; last: none that is known.

    Parameters
    ----------
    runs : each alone
    by_set : (n, sets) of `smoothed`: a run in which no capacity is lost says nothing
    """
    prior = np.array([*((1.0 - SETTINGS.plain) * way.weight for way in WAYS), SETTINGS.plain])
    places = [*range(len(WAYS)), -1]
    lost = by_set @ np.array([float(CAPACITY in each) for each in EVERY])
    alone = [each.way or dict(zip(places, prior.tolist(), strict=True)) for each in runs]
    seen = np.array([[each.get(way, 0.0) for way in places] for each in alone]) / prior
    seen = lost[:, None] * np.maximum(seen, _LEAST) + (1.0 - lost[:, None])
    moves = (1.0 - SETTINGS.other_way) * np.eye(len(prior)) + SETTINGS.other_way * prior[None, :]
    return _passed(seen, moves, prior)


def likeliest_set(by_set: FloatArray) -> Changes:
    """The likeliest set of changes, without those that are hardly likelier to be there beside the others than not.

    Parameters
    ----------
    by_set : (sets,) probability of each, in the order of `EVERY`
    """
    chance = dict(zip(EVERY, by_set.tolist(), strict=True))
    found = max(EVERY, key=lambda each: chance[each])
    while len(found) > 1:
        without = [tuple(each for each in found if each != change) for change in found]
        simpler = max(without, key=lambda each: chance[each])
        if chance[found] >= SETTINGS.beside * chance[simpler]:
            break
        found = simpler
    return found


def change_points(runs: list[Chances]) -> list[ChangePoint]:
    """Where each change that lasts to the end began."""
    by_set, out = smoothed(runs), []
    told = [likeliest_set(each) for each in by_set]
    for change in CHANGES:
        there = by_set @ np.array([float(change in each) for each in EVERY])
        absent = [k for k, each in enumerate(told) if change not in each]
        first = absent[-1] + 1 if absent else 0
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
