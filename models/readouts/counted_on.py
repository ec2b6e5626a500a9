"""Runs whose state of charge at the start was counted on from the end of another run.

A bench that is not charged in between counts from run to run. Where an effect says that the counting was wrong, the run
that is judged begins elsewhere too: else the error of its start would be held against a model that is right. And what
grows with the charge that passes has grown by then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun
from models.network.regression import CellContext
from models.network.signals import soc_by_counting

# What rounding and a grid make of a state of charge that was counted once more.
_SAME_SOC = 1e-4


@dataclass(frozen=True)
class Counting:
    """How charge was counted through runs.

    Attributes
    ----------
    runs, soc : as they were read, with the state of charge at which each was thought to start
    cell : capacity and efficiency that were counted with
    """

    runs: list[GridRun]
    soc: list[float]
    cell: CellContext

    @property
    def ends(self) -> list[float]:
        """State of charge at the end of each run."""
        counted = [
            soc_by_counting(run.charge_Ah, start, self.cell.capacity_Ah, self.cell.efficiency)
            for run, start in zip(self.runs, self.soc, strict=True)
        ]
        return [float(each[-1]) for each in counted]


def counted_anew(stated: list[float], before: Counting, after: Counting) -> list[float]:
    """States of charge at the start, those counted on from the end of a run counted anew.

    Parameters
    ----------
    stated : of each run in question
    before, after : how the runs that may have gone before were counted, and how they are to be
    """
    found = list(stated)
    moved = [(old, new) for old, new in zip(before.ends, after.ends, strict=True) if abs(new - old) >= _SAME_SOC]
    for thought, right in moved:
        found = [right if abs(each - thought) < _SAME_SOC else now for each, now in zip(stated, found, strict=True)]
    return found


def passed_before_Ah(counted: Counting) -> list[float]:
    """Charge that had passed, either way, in the runs that each one was counted on from; 0 where it follows none.

    Parameters
    ----------
    counted : runs in time's order
    """
    ends, found = counted.ends, []
    for number, start in enumerate(counted.soc):
        before = [each for each in range(number) if abs(ends[each] - start) < _SAME_SOC]
        last = before[-1] if before else None
        found.append(0.0 if last is None else found[last] + _throughput_Ah(counted.runs[last]))
    return found


def _throughput_Ah(run: GridRun) -> float:
    return float(np.abs(run.current_A).sum()) * run.dt_s / 3600.0
