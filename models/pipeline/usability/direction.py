"""Runs that only charge, or only discharge."""

from __future__ import annotations

import numpy as np

from models.pipeline.training import Training
from models.pipeline.usability.reason import Reason, limited

# Share of the capacity that has to flow in a direction for it to have been seen: four seconds of 1C, about as long as
# the shortest pulse that shows more than the ohmic drop.
_SEEN = 1e-3


def one_direction(data: Training) -> list[Reason]:
    """Whether one of the two directions of the current was hardly ever there."""
    moved = np.concatenate([np.diff(run.charge_Ah) for run in data.grid]) / data.cell.capacity_Ah
    charged, discharged = float(moved[moved > 0.0].sum()), float(-moved[moved < 0.0].sum())
    if discharged < _SEEN:
        return [_only("charge", "discharged", "discharging")]
    if charged < _SEEN:
        return [_only("discharge", "charged", "charging")]
    return []


def _only(kept: str, never: str, doing: str) -> Reason:
    return limited(
        f"{kept} only: the cell is never {never}, so its resistance while {doing} and its hysteresis are not known; "
        f"add a run, or pulses, in which it is {never}"
    )
