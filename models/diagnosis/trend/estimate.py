"""Capacity and resistance of a cell in one run, found together, beside all that is not known of cell and run.

A linear Gaussian estimate about the likeliest capacity, made again there: what is open of the fresh cell, its error
elsewhere and where the run starts are the same as in the evidence for a change; capacity, resistance and curve may all
have moved.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.trend.choice import chosen, looked_at
from models.diagnosis.trend.ends import Ends, ends_of
from models.diagnosis.trend.loss.causes import caused
from models.diagnosis.trend.prior import About, Given, about
from models.diagnosis.trend.quick import steps_of
from models.diagnosis.trend.settings import SETTINGS, USUAL
from models.diagnosis.trend.weights.latent import COUNT, DIFFERENT, LOOP, NODES, SHIFT, SLIP
from models.diagnosis.trend.weights.sizes import CAPACITY, CHANGES, RESISTANCE, Changes
from models.diagnosis.trend.weights.summed import Summed
from models.diagnosis.trend.weights.weighing import Caused, Chances, Held, chances, held, held_beside, mixed
from models.effects.view import View

# How far a capacity that is no news may be off, in standard deviations: there the cell as it was is linearised.
_NEAR = 2.0
# What may be large while the capacity is looked for.
_SOUGHT = (CAPACITY, RESISTANCE)
# A capacity further from the first guess, relative, asks for covariances of its own.
_AWAY = 5e-3
# Sets of changes that are less likely than this, over the likeliest, say nothing of the state.
_LEAST = 0.02


@dataclass(frozen=True)
class State:
    """A cell as a run shows it.

    Attributes
    ----------
    capacity_Ah, capacity_std_Ah : with its standard deviation
    soc : (n,) at which the resistance is told
    resistance_Ohm, resistance_std_Ohm : (n,) of the first moment after a step of the run's current
    slip, slip_std : by how much the middle of the curve has moved along the SoC, all else being open
    loop_V, loop_std_V : by how much the hysteresis has grown, the same way
    """

    capacity_Ah: float
    capacity_std_Ah: float
    soc: FloatArray
    resistance_Ohm: FloatArray
    resistance_std_Ohm: FloatArray
    slip: float
    slip_std: float
    loop_V: float
    loop_std_V: float


@dataclass(frozen=True)
class Weighed:
    """A run that was held against the cell as it was.

    Attributes
    ----------
    given : the run
    state : of the cell
    chances : of what has changed
    now : what is kept of the run about the capacity that it asks for
    causes : ways to lose a capacity that were held against it, by their numbers
    """

    given: Given
    state: State
    chances: Chances
    now: Summed
    causes: dict[int, Caused] = field(default_factory=dict)

    def told(self, changes: Changes, way: int = -1) -> Held:
        """Weights where just these things have changed; -1: the capacity in no way that is known."""
        return held_beside(self.causes[way], changes) if way in self.causes else held(self.now, changes)


@dataclass(frozen=True)
class Seen:
    """A run about the capacity that it asks for, and about the cell as it was, with all its samples.

    Attributes
    ----------
    given : the run
    now, fresh : about either
    """

    given: Given
    now: About
    fresh: About


def _check(known: KnownRuns, run: GridRun) -> None:
    """Refuse a run that can tell nothing."""
    at, measured = SETTINGS, int(run.measured.sum())
    if measured < at.fewest:
        lasts_s = len(run.voltage_V) * run.dt_s
        short = lasts_s < at.fewest * run.dt_s
        todo = "leave it out" if short else "fit a model to runs that were logged as slowly as this one"
        raise ModelError(
            f"{run.name}: {measured} samples with a voltage on the model's grid of {run.dt_s:g} s in {lasts_s:g} s, at "
            f"least {at.fewest} are needed; {todo}"
        )
    largest_A, least_A = float(np.abs(run.current_A[run.measured]).max()), at.load_C * known.cell.capacity_Ah
    if largest_A < least_A:
        raise ModelError(
            f"{run.name}: its current stays at or below {largest_A:.3g} A, at least {least_A:.3g} A are needed for "
            "capacity and resistance to be told; leave it out"
        )


def seen(known: KnownRuns, run: GridRun, soc: float, soc_std: float) -> Seen:
    """Hold a run against the cell as it was, and find the capacity that it asks for.

    Parameters
    ----------
    known : of the cell as it was
    run : on its grid
    soc, soc_std : at the start, of the new capacity

    Raises
    ------
    ModelError
        No sample of the run can be judged, or hardly any.
    """
    _check(known, run)
    ends = ends_of(known.cell, run, soc)
    change = _first_guess(known.cell, run, soc, ends)
    counted = soc + run.charge_Ah / (known.cell.capacity_Ah * (1.0 + change))
    index = looked_at(known.cell, run, counted, ends)
    given = Given(known, run, soc, soc_std, index, ends, steps_of(known.cell, run, NODES, counted))
    now = _settled(about(given, change), given)
    if abs(now.change - change) > _AWAY:
        now = _settled(about(given, now.change), given)
    near = _NEAR * USUAL.capacity
    fresh = now if abs(now.change) <= near else now.at(given, float(np.clip(now.change, -near, near)))
    return Seen(given, now, fresh)


def weighed(run: Seen, other: Seen | None = None) -> Weighed:
    """Find the state of a cell from one run, and what of it is new.

    Parameters
    ----------
    run : to be weighed
    other : of the cell in the same state, the other way: what charge and discharge show with opposite signs is lost in
        resistances, and what they show alike is the curve
    """
    given, now, fresh = run.given, run.now.summed, run.fresh.summed
    if other is not None:
        now, fresh = now.beside(other.now.summed, DIFFERENT), fresh.beside(other.fresh.summed, DIFFERENT)
    causes = caused(given, run.now, None if other is None else (other.given, other.now))
    chance = chances(fresh, now, causes)
    state = _state(given.known.cell, _averaged(chance, now, causes), held(now, CHANGES))
    return Weighed(given, state, chance, now, causes)


def _settled(now: About, given: Given) -> About:
    """A run about the capacity that it asks for."""
    at = SETTINGS
    for _ in range(at.closer):
        change = float(np.clip(held(now.summed, _SOUGHT).mean[0], at.capacities[0] - 1.0, at.capacities[1] - 1.0))
        if abs(change - now.change) < at.settled:
            break
        now = now.at(given, change)
    return now


def _first_guess(cell: KnownCell, run: GridRun, soc: float, ends: Ends) -> float:
    """Relative change of capacity about which to begin: by the ends, else that by which most samples fit."""
    at = SETTINGS
    low, high, count = at.capacities
    far = np.abs(ends.soc - soc) > at.far_soc
    if far.any():
        share = run.charge_Ah[ends.index][far] / cell.capacity_Ah / (ends.soc - soc)[far]
        return float(np.clip(np.mean(share), low, high)) - 1.0
    index = chosen(np.flatnonzero(run.measured), at.points)
    view = View(cell, run, soc, index)
    charged = run.charge_Ah[index] / cell.capacity_Ah
    shares = np.linspace(low, high, count)
    costs = []
    for share in shares.tolist():
        error_V = run.voltage_V[index] - cell.voltage_V(view.inputs, soc + charged / share)
        costs.append(float(np.mean(np.minimum(np.abs(error_V), at.clipped_V) ** 2)))
    return float(shares[int(np.argmin(costs))]) - 1.0


def _averaged(chance: Chances, now: Summed, causes: dict[int, Caused]) -> Held:
    """Weights over sets of changes with that of the capacity, which is open always, and ways to lose it, as likely."""
    own = {(each, way): p * q for each, p in chance.of.items() if CAPACITY in each for way, q in chance.way.items()}
    taken = {each: p for each, p in own.items() if p >= _LEAST * max(own.values())}
    every = [held_beside(causes[way], each) if way in causes else held(now, each) for each, way in taken]
    return mixed(every, np.array(list(taken.values())), CHANGES)


def _state(cell: KnownCell, found: Held, wide: Held) -> State:
    change, std = float(found.mean[0]), float(np.sqrt(found.covariance[0, 0]))
    # What is called full and empty is not sharp itself, however well a curve fits between them.
    std = float(np.hypot(std, SETTINGS.sharp * (1.0 + change)))
    middle = np.zeros(COUNT)
    middle[[SLIP.start + len(NODES) // 2, SHIFT.start]] = 1.0
    low, high = cell.soc_range
    told = (NODES >= low - KNOWN.away_soc) & (NODES <= high + KNOWN.away_soc)
    return State(
        cell.capacity_Ah * (1.0 + change),
        cell.capacity_Ah * std,
        NODES[told],
        found.resistance_Ohm[told],
        found.resistance_std_Ohm[told],
        float(middle @ wide.mean),
        float(np.sqrt(middle @ wide.covariance @ middle)),
        float(wide.mean[LOOP.start]),
        float(np.sqrt(wide.covariance[LOOP.start, LOOP.start])),
    )
