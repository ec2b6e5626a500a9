"""Where the current changes, which is where a resistance can be told from the open-circuit voltage.

At one current the voltage is the sum of open-circuit voltage and voltage drop, and only the sum is seen. The two come
apart where the current changes faster than the state of charge, or where other runs pass the same state of charge at
another rate in the same direction. Two rates of opposite direction do not help: what differs between charge and
discharge may as well be hysteresis.
"""

from __future__ import annotations

import numpy as np

from models.pipeline.training import Training
from models.pipeline.usability.bins import WIDTH, bin_of, in_words, ranges
from models.pipeline.usability.reason import Reason, limited

# A change of the current is one by so much of the largest current, within two samples: a taper at constant voltage
# takes many minutes for that.
_CHANGE = 0.1
# What a change of the current shows holds for the neighbourhood: pulse tests (HPPC) step by 10 % of charge.
_REACH = 0.1
# Rates that differ by this share of the larger one.
_OTHER_RATE = 0.25
# Below this share of the visited charge, the changes are the ends of charges and discharges: a CC-CV record has them
# within reach of both ends of the range, which is up to four tenths of it.
_ENDS = 0.5
# Stretches shorter than the reach are bridged by the model's smoothness.
_SHORTEST = 0.1


def no_steps(data: Training) -> list[Reason]:
    """Whether, over part of the state of charge, nothing tells resistance from open-circuit voltage."""
    soc = data.counted_soc()
    n = round(1.0 / WIDTH)
    visited, told = np.zeros(n, bool), np.zeros(n, bool)
    largest = max(float(np.abs(run.current_A).max()) for run in data.grid)
    for run, counted in zip(data.grid, soc, strict=True):
        visited[bin_of(counted[run.measured])] = True
        edge = np.zeros(len(run), bool)
        edge[2:] = np.abs(run.current_A[2:] - run.current_A[:-2]) > _CHANGE * largest
        told[bin_of(counted[edge])] = True
    reach = round(_REACH / WIDTH)
    told = np.convolve(told, np.ones(2 * reach + 1), mode="same") > 0.5
    told |= _several_rates(data, soc, n)
    blind = visited & ~told
    if blind.sum() > (1.0 - _ENDS) * visited.sum():
        return [
            limited(
                "constant current only (CC-CV): the current hardly changes between the ends of charge and discharge, "
                "so resistance, hysteresis and open-circuit voltage cannot be told apart; add pulses and rests, "
                "such as one of each every 10 % of charge"
            )
        ]
    found = [(low, high) for low, high in ranges(blind) if high - low > _SHORTEST - 1e-9]
    if not found:
        return []
    return [
        limited(
            f"resistance is not known at a state of charge of {in_words(found)}: the current does not change there; "
            "add pulses there"
        )
    ]


def _several_rates(data: Training, soc: list[np.ndarray], n: int) -> np.ndarray:
    """Parts that were passed at different rates in the same direction."""
    lowest, highest = np.full((2, n), np.inf), np.zeros((2, n))
    for run, counted in zip(data.grid, soc, strict=True):
        part = bin_of(counted)
        starts = np.flatnonzero(np.diff(part, prepend=-1))
        for first, last in zip(starts, [*starts[1:], len(part)], strict=True):
            rate = float(np.median(run.current_A[first:last]))
            if abs(rate) > data.cell.rest_A:
                at = (int(rate > 0.0), part[first])
                lowest[at], highest[at] = min(lowest[at], abs(rate)), max(highest[at], abs(rate))
    return np.asarray(((highest - lowest) > _OTHER_RATE * highest).any(axis=0))
