"""What a service process that died has left open is ended by the next one."""

from bench_service.store import rows
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunRecord
from bench_service.store.samples import SampleReader
from bench_service.streams import content_hash


def mark_interrupted_runs(store: MetadataStore, samples: SampleReader) -> list[RunRecord]:
    """End the runs and campaigns that an earlier service process left open; return those runs.

    To be called at start, after the recorder has started (it waits for the one before to store its last rows). A run
    becomes ``interrupted`` with as many samples as are stored, unless the control process closed it in another state
    after the API process had died.
    """
    store.campaigns.interrupt_open()
    return [_interrupt(store, run, samples) for run in store.runs.still_open()]


def _interrupt(store: MetadataStore, run: RunRecord, samples: SampleReader) -> RunRecord:
    closed = samples.closed(run.id)
    if closed is None:
        reason = "the service ended in the middle of it"
        data = samples.read(run.id)
        digest = None if data.damaged else content_hash(data.columns)
        return store.runs.end(run.id, "interrupted", reason, n_samples=samples.n_rows(run.id), sha256=digest)
    state = rows.run_state(closed.state)
    return store.runs.end(run.id, state, closed.reason, n_samples=closed.n_samples, sha256=closed.sha256)
