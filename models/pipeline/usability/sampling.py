"""Logs that are too slow for the load, or for what answers it."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import TimeSeries
from models.pipeline.training import Training
from models.pipeline.usability.reason import Reason, limited

# Charge transfer and the double layer settle in 0.1 to 10 s; logged more slowly than that, they are one with the ohmic
# drop.
_FAST_S = 10.0
# A change of the current by this share of the largest is one of the load.
_CHANGE = 0.1
# With fewer samples than this for each level, most samples are means over, or points within, something that moved.
_SAMPLES_A_LEVEL = 3.0
_FEWEST_CHANGES = 10


def logged_too_slowly(data: Training) -> list[Reason]:
    """Whether the interval of the log leaves open what the load did, or how fast the cell answered."""
    interval_s = float(np.median(np.concatenate([np.diff(run.time_s) for run in data.runs])))
    if interval_s <= _FAST_S:
        return []
    level = samples_a_level(data.runs)
    if level < _SAMPLES_A_LEVEL:
        return [
            limited(
                f"logged too slowly: one sample every {interval_s:.0f} s, but the load changes every "
                f"{level * interval_s:.0f} s: what flowed between two samples is not known, so resistance and charge "
                "are not; log every second"
            )
        ]
    return [
        limited(
            f"logged slowly: one sample every {interval_s:.0f} s: what the cell does within the first "
            f"{interval_s:.0f} s of a load cannot be told from its ohmic resistance; the model is for slow loads only. "
            "Log every second where the current changes"
        )
    ]


def samples_a_level(runs: list[TimeSeries]) -> float:
    """Samples for each level of the current; infinite where it hardly changes."""
    largest = max(float(np.nanmax(np.abs(run.current_A), initial=0.0)) for run in runs)
    changes = sum(int((np.abs(np.diff(run.current_A)) > _CHANGE * largest).sum()) for run in runs)
    return sum(len(run) for run in runs) / changes if changes >= _FEWEST_CHANGES else float("inf")
