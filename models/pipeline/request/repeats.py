"""Runs that were given twice: a file under two names, or one that is to judge what was made from it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import TimeSeries
from models.pipeline.request.fit_request import FitRequest


def same_record(one: TimeSeries, other: TimeSeries) -> bool:
    """Whether two runs hold the same samples, whatever they are called."""
    return all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
        for name in ("time_s", "current_A", "voltage_V")
    )


@dataclass(frozen=True)
class Once:
    """A request in which each training run stands once.

    Attributes
    ----------
    request : without repeats
    place : of each run that was given, in the request
    remarks : what is to be said
    """

    request: FitRequest
    place: list[int]
    remarks: list[str]


def without_repeats(request: FitRequest) -> Once:
    """Take each training run once; one that also judges is kept there, and said."""
    kept: list[int] = []
    place: list[int] = []
    remarks = []
    for k, run in enumerate(request.train):
        first = next((j for j in kept if same_record(request.train[j], run)), None)
        place.append(len(kept) if first is None else kept.index(first))
        if first is None:
            kept.append(k)
        else:
            remarks.append(f"{run.name} is the same record as {request.train[first].name}: it is used once")
    for judge in request.validate or []:
        if any(same_record(judge, run) for run in request.train):
            remarks.append(f"{judge.name} judges the model and was also learned from: its error says nothing of others")
    if len(kept) == len(request.train):
        return Once(request, place, remarks)
    soc = None if not request.initial_soc else [request.initial_soc[k] for k in kept]
    once = replace(request, train=[request.train[k] for k in kept], initial_soc=soc)
    return Once(once, place, remarks)
