"""Damaged chunks put right where that can be proved, else taken out; the records then say what is there.

What is taken out is kept as a file of its own in the folder ``damaged`` of the data directory.
"""

import json
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Row, delete, select, update

from bench_service.errors import StoreError
from bench_service.store import engine as engines
from bench_service.store.blocks import Block, BlockError, decode
from bench_service.store.correction import corrected
from bench_service.store.engine import WriterLock
from bench_service.store.intact import block_of, time_range
from bench_service.store.integrity import Expected, damage_of
from bench_service.store.metadata import MetadataStore
from bench_service.store.migrate import upgrade
from bench_service.store.records import Json, RunRecord
from bench_service.store.samples import FILE, LOCK_FILE, SampleReader
from bench_service.store.schema import chunk, closed_run
from bench_service.streams import content_hash

FOLDER = "damaged"


@dataclass(frozen=True, slots=True)
class Repaired:
    """What was done for a run.

    Attributes
    ----------
    run_id : str
    restored : int
        Chunks put right to the bit.
    removed : int
        Chunks taken out.
    samples_lost : int
        Samples that are not there any more.
    whole : bool
        Whether the run is again the one that was recorded, proved by its hash.
    """

    run_id: str
    restored: int
    removed: int
    samples_lost: int
    whole: bool

    def to_json(self) -> Json:
        """Return a JSON object."""
        return {
            "run": self.run_id,
            "chunks_restored": self.restored,
            "chunks_removed": self.removed,
            "samples_lost": self.samples_lost,
            "whole": self.whole,
        }


def repair(data_dir: Path, run_ids: list[str]) -> list[Repaired]:
    """Repair the samples of runs; nobody else may have the data directory.

    Raises
    ------
    StoreError
        Another process writes metadata or samples, or the files cannot be written.
    """
    with closing(MetadataStore.open(data_dir)) as store, closing(WriterLock.acquire(data_dir / LOCK_FILE)):
        engine = engines.open_writer(data_dir / FILE)
        try:
            upgrade(engine, "samples")
            return [_repair(engine, store, data_dir, store.runs.get(run_id)) for run_id in run_ids]
        finally:
            engine.dispose()


def _repair(engine: engines.Engine, store: MetadataStore, data_dir: Path, run: RunRecord) -> Repaired:
    restored = removed = 0
    with engine.begin() as link:
        for row in link.execute(select(chunk).where(chunk.c.run_id == run.id).order_by(chunk.c.seq0)).all():
            sound = _sound(row)
            if sound is None:
                _set_aside(data_dir / FOLDER, row)
                link.execute(delete(chunk).where(chunk.c.id == row.id))
                removed += 1
            elif sound != _as_stored(row):
                link.execute(update(chunk).where(chunk.c.id == row.id).values(sound))
                restored += 1
    with closing(SampleReader(data_dir)) as reader:
        data = reader.read(run.id)
    whole = damage_of(Expected(run.id, run.n_samples, run.sha256), data) is None
    lost = max((run.n_samples or 0) - data.n, 0)
    done = Repaired(run.id, restored, removed, lost, whole)
    if whole:
        store.runs.note_damage(run.id, None)
        _tell(store, run, "info", f"is whole again: {restored} chunks were put right")
    else:
        digest = content_hash(data.columns)
        loss = f"{lost} of {data.n + lost} samples are lost, the others are as they were recorded"
        store.runs.correct(run.id, data.n, digest, loss)
        with engine.begin() as link:
            _correct_closed(link, run.id, data.n, digest)
        _tell(store, run, "warning", f"was repaired: {loss}")
    return done


def _sound(row: Row[Any]) -> Json | None:
    """Return what should stand in a chunk's row; None where nobody knows."""
    block = block_of(row)
    try:
        _, columns = decode(block)
    except BlockError:
        found = corrected(block)
        if found is None:
            return None
        block = found
        _, columns = decode(block)
    t0, t1 = time_range(columns)
    return {"seq0": block.seq0, "n": block.n, "t0": t0, "t1": t1, "crc": block.crc, "data": block.data}


def _as_stored(row: Row[Any]) -> Json:
    return {name: getattr(row, name) for name in ("seq0", "n", "t0", "t1", "crc", "data")}


def _set_aside(folder: Path, row: Row[Any]) -> None:
    """Keep a chunk that is taken out: its bytes, and what stood beside them."""
    block: Block = block_of(row)
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        stem = f"{row.run_id}-{row.stream}-{row.id}"
        (folder / f"{stem}.block").write_bytes(block.data)
        beside = {name: getattr(row, name) for name in ("run_id", "stream", "seq0", "n", "t0", "t1", "codec", "crc")}
        (folder / f"{stem}.json").write_text(json.dumps(beside) + "\n")
    except OSError as error:
        raise StoreError(f"cannot keep the damaged chunk {row.id} in {folder}: {error.strerror}") from error


def _correct_closed(link: Connection, run_id: str, n: int, digest: str) -> None:
    link.execute(update(closed_run).where(closed_run.c.run_id == run_id).values(n_samples=n, sha256=digest))


def _tell(store: MetadataStore, run: RunRecord, severity: Any, text: str) -> None:
    said = f"{run.called} {text}"
    store.events.add(severity, "run_repaired", said, bench=run.bench, run_id=run.id, campaign_id=run.campaign_id)
