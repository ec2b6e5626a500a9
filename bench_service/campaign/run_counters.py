"""What the steps and cycles of a run have moved, also of one that goes on from others."""

from __future__ import annotations

from typing import Any

import numpy as np

from bench_service.protocol.tables import cycle_table, step_table
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunRecord
from bench_service.store.samples import SampleReader
from bench_service.streams import STEPS


def parts_before(store: MetadataStore, run: RunRecord) -> list[RunRecord]:
    """Return the runs of a protocol that a run goes on from, and itself, in the order in which they were played."""
    parts = [run]
    while parts[0].continues is not None and parts[0].protocol_id is not None:
        before = store.runs.get(parts[0].continues)
        if before.protocol_id != run.protocol_id or before in parts:
            break
        parts.insert(0, before)
    return parts


def steps_of(store: MetadataStore, samples: SampleReader, run_id: str) -> list[dict[str, Any]]:
    """Return the steps of a run, those of the runs that it goes on from included; raises `NotFoundError`."""
    parts = [samples.read(part.id, STEPS) for part in parts_before(store, store.runs.get(run_id))]
    filled = [part.columns for part in parts if part.n]
    if not filled:
        return []
    return step_table({name: np.concatenate([each[name] for each in filled]) for name in filled[0]})


def cycles_of(store: MetadataStore, samples: SampleReader, run_id: str) -> list[dict[str, Any]]:
    """Return the cycles of a run; see `steps_of`."""
    return cycle_table(steps_of(store, samples, run_id))
