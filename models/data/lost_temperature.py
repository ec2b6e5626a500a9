"""A temperature that is not logged for a while, as a sensor that falls off or a channel that comes late leaves it.

What is missing is put on the grid as a straight line between the values around it, and flat before the first and after
the last. A cell's temperature settles in ten minutes to an hour, so that this holds for some minutes.
"""

from __future__ import annotations

import numpy as np

from models.data.timeseries import TimeSeries

# Longer than this the values around a gap do not say what the temperature was in it.
BRIDGED_S = 600.0


def without_temperature_s(run: TimeSeries) -> float:
    """Longest time from one temperature to the next, in s, over rows that have a voltage and none; 0 without such rows.

    Before the first and after the last temperature it counts from the run's start and to its end.
    """
    known = ~np.isnan(run.temperature_degC)
    lacking = ~known & ~np.isnan(run.voltage_V)
    edges = np.unique(np.concatenate([[0], np.flatnonzero(known), [len(run) - 1]]))
    # The edges themselves lack it at the run's ends only.
    before = np.concatenate([[0], np.cumsum(lacking)])
    lost = before[edges[1:] + 1] > before[edges[:-1]]
    return float(np.max(np.diff(run.time_s[edges])[lost], initial=0.0))


def lost_temperature(run: TimeSeries) -> list[str]:
    """What is to be said of a run of which only a part has a temperature; nothing where it is bridged."""
    longest_s = without_temperature_s(run)
    if longest_s <= BRIDGED_S or np.isnan(run.temperature_degC).all():
        return []
    return [
        f"{run.name}: the temperature is missing for up to {longest_s:.0f} s at a time and was taken to go evenly from "
        "the value before to the one after, or to stay as it was where there is none"
    ]
