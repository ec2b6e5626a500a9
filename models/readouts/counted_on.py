"""Runs whose state of charge at the start was counted on from the end of another run.

A bench that is not charged in between counts from run to run. Where an effect says that the counting was wrong, the run
that is judged begins elsewhere too: else the error of its start would be held against a model that is right.
"""

from __future__ import annotations

from models.data.resampling import GridRun
from models.network.regression import CellContext
from models.network.signals import soc_by_counting

# What rounding and a grid make of a state of charge that was counted once more.
_SAME_SOC = 1e-4


def counted_anew(
    stated: list[float],
    runs: list[GridRun],
    soc: tuple[list[float], list[float]],
    cell: tuple[CellContext, CellContext],
) -> list[float]:
    """States of charge at the start, those counted on from the end of a run counted anew.

    Parameters
    ----------
    stated : of each run in question
    runs : that may have gone before
    soc : at which each of these was thought to start, and at which it does
    cell : capacity and efficiency that were counted with, and those that are right
    """
    ends = [_ends(runs, starts, each) for starts, each in zip(soc, cell, strict=True)]
    found = list(stated)
    for before, after in zip(*ends, strict=True):
        found = [
            after if abs(thought - before) < _SAME_SOC else now for thought, now in zip(stated, found, strict=True)
        ]
    return found


def _ends(runs: list[GridRun], starts: list[float], cell: CellContext) -> list[float]:
    counted = [
        soc_by_counting(run.charge_Ah, start, cell.capacity_Ah, cell.efficiency)
        for run, start in zip(runs, starts, strict=True)
    ]
    return [float(each[-1]) for each in counted]
