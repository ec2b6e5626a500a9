"""Stored runs as inputs of long work."""

from __future__ import annotations

from bench_service.errors import ConflictError, GivenUpError
from bench_service.jobs.series import RunInput
from bench_service.store.integrity import damaged
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import OPEN_RUN_STATES


def run_input(store: MetadataStore, run_id: str, initial_soc: float | None = None, field: str = "run") -> RunInput:
    """Look a run up for a worker; `initial_soc` replaces its own.

    Raises
    ------
    NotFoundError, ConflictError
        It is not there, or has not ended.
    DamagedError
        Samples of it are known to be missing.
    """
    run = store.runs.get(run_id)
    if run.state in OPEN_RUN_STATES:
        raise ConflictError(f"run {run_id} has not ended; wait for its end or stop it", (field, run_id))
    if run.removed_utc is not None:
        raise GivenUpError(f"the samples of run {run_id} were given up at {run.removed_utc}", (field, run_id))
    if run.damage is not None:
        raise damaged(run_id, run.damage)
    start = run.initial_soc if initial_soc is None else initial_soc
    return RunInput(run_id, start, run.n_samples, run.sha256)
