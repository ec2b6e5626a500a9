"""Where the cell on a bench stands, as far as its last run tells."""

from __future__ import annotations

from dataclasses import dataclass

from bench_service.campaign.benches import Bench
from bench_service.jobs.counting import counted_soc
from bench_service.store.integrity import Expected, damage_of
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import OPEN_RUN_STATES, RunRecord
from bench_service.store.samples import SampleReader

# Runs that were refused have no samples and are passed over; nobody has a hundred of them in a row.
_LATEST_RUNS = 100


@dataclass(frozen=True, slots=True)
class Standing:
    """A state of charge, 0..1, and where that is known from."""

    soc: float
    source: str


def last_standing(bench: Bench, store: MetadataStore, samples: SampleReader) -> Standing | None:
    """Count the charge of the bench's last run with samples; None where that tells nothing.

    A simulated cell stands where its last run has left it, whatever that run's end. Of a real cell only a run that
    was completed, with every sample stored, is believed: what happened after another end nobody has counted.
    Reads the store, so it is called in a thread.
    """
    run = _last_run(bench, store)
    if run is None or (bench.config.simulate is None and run.state != "completed"):
        return None
    data = samples.read(run.id)
    if data.n == 0 or (bench.config.simulate is None and damage_of(Expected.of(run), data) is not None):
        return None
    columns = data.columns
    soc = float(counted_soc(columns["time_s"], columns["current_A"], run.initial_soc, run.capacity_Ah)[-1])
    return Standing(min(max(soc, 0.0), 1.0), f"the end of run {run.id}")


def _last_run(bench: Bench, store: MetadataStore) -> RunRecord | None:
    if bench.config.simulate is None and bench.cell is not None:
        # Wherever it was: a run that was brought in from a file tells of a bench that nobody has counted on since.
        run = _last_with_samples(store.runs.page(cell_id=bench.cell.id, limit=_LATEST_RUNS))
        played = run is not None and (run.profile_id or run.protocol_id) is not None
        return run if played else None
    run = _last_with_samples(store.runs.page(bench=bench.name, limit=_LATEST_RUNS))
    if run is None or run.number <= bench.runs_before_cell:
        return None  # of another cell
    if bench.config.simulate is not None:
        return run
    # Nobody has named the cell that is there: it is that of the last run only where nothing was put there since.
    since_utc = bench.cell_since_utc
    return run if run.cell_id is None and (since_utc is None or run.created_utc > since_utc) else None


def _last_with_samples(runs: list[RunRecord]) -> RunRecord | None:
    return next((run for run in runs if run.state not in OPEN_RUN_STATES and run.n_samples != 0), None)
