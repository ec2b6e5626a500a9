"""Profiles out of requests: what a request names is looked up, the design made by a worker, the profile stored."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.errors import BadRequestError, ConflictError
from bench_service.jobs.designing import design_profile
from bench_service.jobs.modelling import RunInput
from bench_service.jobs.runner import Job, JobRunner
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import OPEN_RUN_STATES, Json

_Inputs = tuple[Json | None, list[RunInput], tuple[list[float], list[float]] | None]


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

    async def start(self, name: str, request: Mapping[str, Any]) -> Job:
        """Queue a design; the job's result is ``{"profile_id", "name", "figures"}``.

        Parameters
        ----------
        name : str
            Of the profile.
        request : mapping
            Keys of the public contract; ``model``, ``load_cycle`` and ``runs`` name a stored model, profile and runs.

        Raises
        ------
        ModelError
            The request cannot be read.
        NotFoundError, ConflictError
            A model, profile or run is not there, or a run has not ended.
        """
        document, runs, cycle = await asyncio.to_thread(self._inputs, request)

        def keep(result: Json) -> Json:
            time_s, current_A = np.array(result["time_s"]), np.array(result["current_A"])
            record = self._store.add_profile(name, time_s, current_A)
            return {"profile_id": record.id, "name": name, "figures": result["figures"]}

        return self._jobs.submit(
            "design", design_profile, self._data_dir, dict(request), document, runs, cycle, store=keep
        )

    def _inputs(self, request: Mapping[str, Any]) -> _Inputs:
        # Here and not above: the first design in a service's life pays for it, not its start.
        from models.design.request import read_request

        written = read_request(request)
        if written.rivals:
            raise BadRequestError("rivals are not stored models yet", ("rivals",), remedy="use the command line")
        document = None if written.model is None else self._store.model_document(written.model)
        cycle = None
        if written.load_cycle is not None:
            time_s, current_A = self._store.profile_points(written.load_cycle)
            cycle = (time_s.tolist(), current_A.tolist())
        return document, [self._run(run_id) for run_id in written.runs], cycle

    def _run(self, run_id: str) -> RunInput:
        run = self._store.run(run_id)
        if run.state in OPEN_RUN_STATES:
            raise ConflictError(f"run {run_id} has not ended; wait for its end or stop it", ("runs", run_id))
        return RunInput(run_id, run.initial_soc)
