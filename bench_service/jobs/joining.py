"""Runs that follow each other on one cell as one log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.data.timeseries import TimeSeries


def joined(series: Sequence[TimeSeries], pauses_s: Sequence[float]) -> TimeSeries:
    """Put runs one behind the other, the pauses between them without samples.

    A run by itself is taken to begin with a cell that has forgotten everything. One that follows another has not: its
    hysteresis is where the other has left it, and slow relaxation goes on. Both ends of a pause are at rest, so that
    the grid of a model takes it as a rest of which no voltage is known.

    Parameters
    ----------
    series : at least one, in their order
    pauses_s : from the last sample of each to the first of the next, positive; one fewer than runs

    Returns
    -------
    TimeSeries
        Its ambient temperature is known where that of all runs is.
    """
    if len(series) == 1:
        return series[0]
    lengths_s = [each.duration_s + pause_s for each, pause_s in zip(series[:-1], pauses_s, strict=True)]
    starts = np.concatenate([[0.0], np.cumsum(lengths_s)])
    ambient = [each.ambient_degC for each in series if each.ambient_degC is not None]
    return TimeSeries(
        time_s=np.concatenate([at + each.time_s - each.time_s[0] for at, each in zip(starts, series, strict=True)]),
        current_A=np.concatenate([each.current_A for each in series]),
        voltage_V=np.concatenate([each.voltage_V for each in series]),
        temperature_degC=np.concatenate([each.temperature_degC for each in series]),
        ambient_degC=np.concatenate(ambient) if len(ambient) == len(series) else None,
        name=" then ".join(each.name for each in series),
    )
