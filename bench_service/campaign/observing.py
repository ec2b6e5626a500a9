"""Observers on stored runs: inputs looked up, work handed to a worker."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench_service.campaign.modelling import Modelling
from bench_service.jobs.observing import observe_runs
from bench_service.jobs.runner import Job, JobRunner
from bench_service.store.metadata import MetadataStore


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservationOrder:
    """Stored runs to be replayed through a model's observer.

    `initial_soc`: where the observer begins; None: where each run is said to begin. `gain`: "kalman" or "steady"; None:
    as the model has it.
    """

    model_id: str
    run_ids: Sequence[str]
    initial_soc: float | None = None
    gain: str | None = None


class Observing:
    """Observes stored runs.

    Parameters
    ----------
    store : MetadataStore
    jobs : JobRunner
    modelling : Modelling
        Looks runs up.
    data_dir : Path
        Where workers read samples.
    """

    def __init__(self, store: MetadataStore, jobs: JobRunner, modelling: Modelling, data_dir: Path) -> None:
        self._store, self._jobs, self._modelling, self._data_dir = store, jobs, modelling, data_dir

    async def start_observation(self, order: ObservationOrder) -> Job:
        """Queue it; the job's result is the ``observe`` object of the public contract.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            Model or run are not there, a run has not ended or is named twice.
        """
        document = await asyncio.to_thread(self._store.models.document, order.model_id)
        runs = await asyncio.to_thread(self._modelling.inputs, order.run_ids, "run_ids", None)
        given = (document, runs, order.initial_soc, order.gain)
        return self._jobs.submit("observation", observe_runs, self._data_dir, *given)
