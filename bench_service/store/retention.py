"""Samples that nobody needs any more are given up: by age, and never those that a model or a result rests on."""

from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from sqlalchemy import delete

from bench_service.store import engine as engines
from bench_service.store.engine import WriterLock
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunRecord, utc_text
from bench_service.store.samples import FILE, LOCK_FILE
from bench_service.store.schema import chunk

_ALL = 10**6


@dataclass(frozen=True, slots=True)
class Old:
    """Runs that may go, and how many of the same age stay because something rests on them."""

    runs: list[RunRecord]
    n_kept: int


def old_runs(store: MetadataStore, days: float) -> Old:
    """Return the runs with samples that ended longer ago than `days`."""
    before = utc_text(datetime.now(UTC) - timedelta(days=days))
    needed = _needed(store)
    aged = [run for run in store.runs.ended() if run.n_samples and (run.ended_utc or run.created_utc) < before]
    return Old([run for run in aged if run.id not in needed], sum(run.id in needed for run in aged))


def give_up(data_dir: Path, days: float) -> Old:
    """Delete the samples of old runs; their records stay and say so. Nobody else may have the data directory.

    Raises
    ------
    StoreError
        Another process writes metadata or samples.
    """
    with closing(MetadataStore.open(data_dir)) as store, closing(WriterLock.acquire(data_dir / LOCK_FILE)):
        old = old_runs(store, days)
        if not old.runs:
            return old
        engine = engines.open_writer(data_dir / FILE)
        try:
            for run in old.runs:
                # The record first: a crash in between leaves samples too many, and nobody misses any.
                store.runs.give_up(run.id)
                with engine.begin() as link:
                    link.execute(delete(chunk).where(chunk.c.run_id == run.id))
                told = f"{run.called}: its {run.n_samples} samples were given up after {days:g} days"
                store.events.add("info", "samples_given_up", told, bench=run.bench, run_id=run.id, cell_id=run.cell_id)
            engines.compact(engine)
        finally:
            engine.dispose()
        text = f"samples of {len(old.runs)} runs older than {days:g} days were given up"
        store.events.add("info", "retention", text)
    return old


def _needed(store: MetadataStore) -> set[str]:
    """Runs that a model was made from or judged on, or that a comparison or diagnosis looked at."""
    needed = {each.run_id for model in store.models.page(_ALL) for each in (*model.train, *model.validate)}
    needed |= {each.run_id for comparison in store.comparisons.page(None, _ALL) for each in comparison.runs}
    return needed | {each.run_id for found in store.diagnoses.page(None, _ALL) for each in (*found.runs, *found.train)}
