"""Profiles out of requests: what a request names is looked up, the design made by a worker, the profile stored."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.bench.limits import Limits
from bench_service.campaign.inputs import run_input
from bench_service.campaign.report_headings import design_heading
from bench_service.campaign.request import CampaignRequest
from bench_service.errors import ConflictError, NotFoundError
from bench_service.jobs.designing import design_profile
from bench_service.jobs.runner import Job, JobRunner
from bench_service.jobs.series import RunInput
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json, RunRecord

_Inputs = tuple[Json | None, list[RunInput], tuple[list[float], list[float]] | None, list[Json | str]]

KIND = "design"
# Reports that are kept; each is some 200 kB.
_PAGES = 50
# Levels of a round's sequence: as many as its time still leaves a block of some minutes at each, down and up.
_ROUND_LEVELS = 8


class Designing:
    """Designs profiles.

    Parameters
    ----------
    store : MetadataStore
    jobs : JobRunner
    data_dir : Path
        Where workers read samples.
    """

    def __init__(self, store: MetadataStore, jobs: JobRunner, data_dir: Path) -> None:
        self._store, self._jobs, self._data_dir = store, jobs, data_dir
        self._pages: OrderedDict[str, bytes] = OrderedDict()

    async def start(self, name: str, request: Mapping[str, Any], *, report: bool = False) -> Job:
        """Queue a design; the job's result is ``{"profile_id", "name", "figures"}``.

        Parameters
        ----------
        name : str
            Of the profile.
        request : mapping
            Keys of the public contract; ``model``, ``load_cycle`` and ``runs`` name a stored model, profile and runs,
            ``rivals`` stored models or effects.
        report : bool
            Whether its report is written too, which takes a part of the design's own time.

        Raises
        ------
        ModelError
            The request cannot be read.
        NotFoundError, ConflictError
            A model, profile or run is not there, or a run has not ended.
        """
        document, runs, cycle, rivals = await asyncio.to_thread(self._inputs, request)
        heading = await asyncio.to_thread(design_heading, self._store, name, request.get("model")) if report else None

        def keep(result: Json) -> Json:
            time_s, current_A = np.array(result["time_s"]), np.array(result["current_A"])
            record = self._store.profiles.add(name, time_s, current_A)
            if result["page"] is not None:
                self._pages[record.id] = result["page"]
                while len(self._pages) > _PAGES:
                    self._pages.popitem(last=False)
            return {"profile_id": record.id, "name": name, "figures": result["figures"]}

        inputs = (dict(request), document, runs, cycle, rivals, heading)
        return self._jobs.submit(KIND, design_profile, self._data_dir, *inputs, store=keep)

    def report(self, job_id: str) -> bytes:
        """Give the report of a design, as long as it is kept.

        Raises
        ------
        NotFoundError
            There is no such job, it is none of these, or too many came after it.
        ConflictError
            It has not been made.
        """
        job = self._jobs.get(job_id)
        if job.kind != KIND:
            raise NotFoundError(f"job {job_id} is no design: it is a {job.kind}", ("job",))
        if job.result is None:
            raise ConflictError(f"job {job_id} is {job.state}; its report is not there", ("job",))
        page = self._pages.get(job.result["profile_id"])
        if page is None:
            raise NotFoundError(f"the report of job {job_id} is not kept any more: design it again", ("job",))
        return page

    def _inputs(self, request: Mapping[str, Any]) -> _Inputs:
        # Lazy: numba and scipy take 1.2 s; the first use in a service's life pays for it, not its start.
        from models.design.request import read_request
        from models.design.rivals import is_effect

        written = read_request(request)
        document = None if written.model is None else self._store.models.document(written.model)
        cycle = None
        if written.load_cycle is not None:
            time_s, current_A = self._store.profiles.points(written.load_cycle)
            cycle = (time_s.tolist(), current_A.tolist())
        rivals = [rival if is_effect(rival) else self._store.models.document(rival) for rival in written.rivals]
        return document, [self._run(run_id) for run_id in written.runs], cycle, rivals

    def _run(self, run_id: str) -> RunInput:
        return run_input(self._store, run_id, field="runs")


def round_request(request: CampaignRequest, limits: Limits, model_id: str, soc: float, number: int) -> Json:
    """Ask for the sequence of a round, within the campaign's limits and those of its bench.

    Parameters
    ----------
    request : CampaignRequest
    limits : Limits
        Of the bench, for set-points that change at samples.
    model_id : str
        Model of the rounds before.
    soc : float
        Where the cell stands.
    number : int
        Of the round.
    """
    low, high = request.soc
    windows: Json = {
        "current_A": list(request.current_A),
        "voltage_V": list(limits.voltage_V),
        # Counting noisy currents ends a little beside the plan.
        "soc": [min(low, soc), max(high, soc)],
    }
    if limits.ramp_A_per_s is not None:
        windows["ramp_A_per_s"] = [-limits.ramp_A_per_s, limits.ramp_A_per_s]
    return {
        "model": model_id,
        "capacity_Ah": request.capacity_Ah,
        "initial_soc": soc,
        "duration_s": request.duration_s,
        "limits": windows,
        "soc_levels": _ROUND_LEVELS,
        "seed": request.seed + number,
    }


def pauses_between_s(runs: Sequence[RunRecord], lock_step: bool) -> list[float]:
    """How long the cell rested between runs that followed each other; in lock-step it lives in its runs only."""
    return [max(0.0 if lock_step else _pause_s(*pair), pair[1].dt_s) for pair in pairwise(runs)]


def _pause_s(before: RunRecord, after: RunRecord) -> float:
    if before.ended_utc is None or after.started_utc is None:
        return 0.0
    return (datetime.fromisoformat(after.started_utc) - datetime.fromisoformat(before.ended_utc)).total_seconds()
