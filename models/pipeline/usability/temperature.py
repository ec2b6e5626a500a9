"""Runs without a temperature, or without one for a part of them."""

from __future__ import annotations

import numpy as np

from models.data.lost_temperature import BRIDGED_S, without_temperature_s
from models.pipeline.training import Training
from models.pipeline.usability.reason import Reason, limited


def no_temperature(data: Training) -> list[Reason]:
    """Whether a run's temperature is not known."""
    without = [run.name for run in data.runs if np.isnan(run.temperature_degC).all()]
    if not without:
        return []
    who = "no run has a temperature" if len(without) == len(data.runs) else f"no temperature in {', '.join(without)}"
    return [
        limited(
            f"{who}: the model holds at the temperature of these runs only, whatever it was, and a cell that warms "
            "under load is taken for one whose resistance falls; log the cell's temperature"
        )
    ]


def interrupted_temperature(data: Training) -> list[Reason]:
    """Whether a run's temperature is known for a part of it only."""
    lost_s = {run.name: without_temperature_s(run) for run in data.runs if not np.isnan(run.temperature_degC).all()}
    who = [f"{name} ({seconds:.0f} s at a time)" for name, seconds in lost_s.items() if seconds > BRIDGED_S]
    if not who:
        return []
    return [
        limited(
            f"the temperature is missing in {', '.join(who)}: it was taken to go evenly from the value before to the "
            "one after, or to stay as it was, and a cell that warms meanwhile is taken for one whose resistance falls; "
            "log the cell's temperature throughout, or leave that part out"
        )
    ]
