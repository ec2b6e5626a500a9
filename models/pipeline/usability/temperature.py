"""Runs without a temperature."""

from __future__ import annotations

import numpy as np

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
