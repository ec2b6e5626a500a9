"""Runs that were given twice: a file under two names, or one that is to judge what was made from it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from models.data.errors import ModelError
from models.data.run_order import run_order, same_record
from models.pipeline.request.fit_request import FitRequest


@dataclass(frozen=True)
class Once:
    """A request in which each training run stands once, in the order of `run_order`.

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
    """Take each training run once, in an order of their own; one that also judges is kept there, and said.

    Raises
    ------
    ModelError
        Not one SoC for each run.
    """
    if request.initial_soc and len(request.initial_soc) != len(request.train):
        raise ModelError(
            f"{len(request.initial_soc)} initial SoC(s) for {len(request.train)} training run(s): give one for each"
        )
    first: list[int] = []
    remarks = []
    for run in request.train:
        first.append(next(j for j, other in enumerate(request.train) if same_record(other, run)))
        if first[-1] != len(first) - 1:
            remarks.append(f"{run.name} is the same record as {request.train[first[-1]].name}: it is used once")
    for judge in request.validate or []:
        if any(same_record(judge, run) for run in request.train):
            remarks.append(f"{judge.name} judges the model and was also learned from: its error says nothing of others")
    kept = sorted(set(first))
    kept = [kept[k] for k in run_order([request.train[k] for k in kept])]
    soc = None if not request.initial_soc else [request.initial_soc[k] for k in kept]
    once = replace(request, train=[request.train[k] for k in kept], initial_soc=soc)
    return Once(once, [kept.index(k) for k in first], remarks)
