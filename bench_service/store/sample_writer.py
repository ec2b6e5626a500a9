"""Writing samples: the recorder process alone does this.

A second's rows of all streams are one transaction, so that a power cut loses whole seconds and never half of one.
When a run ends, or has gathered enough, its small chunks are merged ("sealed") into large ones: a long run is then
read an order of magnitude faster.
"""

import logging
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import Connection, Engine, Row, delete, func, select
from sqlalchemy.exc import DBAPIError

from bench_service.errors import StoreError
from bench_service.store import engine as engines
from bench_service.store.blocks import BlockError, decode, encode
from bench_service.store.digest import stored_hash
from bench_service.store.engine import WriterLock
from bench_service.store.intact import block_of, time_range
from bench_service.store.migrate import upgrade
from bench_service.store.private import make_private_directory, make_private_file
from bench_service.store.samples import (
    FILE,
    LOCK_FILE,
    ClosedRun,
    count_rows,
    describe,
    read_closed,
)
from bench_service.store.schema import chunk, closed_run
from bench_service.store.watch import RESERVE_BYTES, FolderWatch
from bench_service.streams import SAMPLES, Columns, Layout

# A foreign program that holds the file for 30 s costs no sample: the benches' queues hold 60 s.
BUSY_TIMEOUT_S = 40.0
SEALED_ROWS = 100_000
SEALED_S = 3600.0
_UNTIL_IN_ORDER = "nothing more is recorded until the disk is in order"
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows without a hole, ``seq0`` onwards, of one stream of one run; columns of shape (n,)."""

    run_id: str
    stream: str
    seq0: int
    layout: Layout
    columns: Columns

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.columns[self.layout[0].name])


@dataclass(slots=True)
class _Fresh:
    """Rows of a stream that are stored but not sealed."""

    rows: int = 0
    t0: float = float("inf")
    t1: float = float("-inf")


class SampleWriter:
    """The one writing connection of ``samples.sqlite``; for one thread.

    After a failed write nothing more may be written: what the disk holds is then not known (a second fsync may
    report success for pages that the first one lost): the process must then end without touching the file, not even
    by `close`, which would write back the log.
    """

    def __init__(self, lock: WriterLock, engine: Engine, watch: FolderWatch) -> None:
        self._lock = lock
        self._engine = engine
        self._watch = watch
        self._fresh: dict[tuple[str, str], _Fresh] = {}

    @classmethod
    def open(cls, data_dir: Path, lock_timeout_s: float = 0.0) -> "SampleWriter":
        """Open, or create, the samples of a data directory for writing.

        Raises
        ------
        StoreError
            Another process writes them, or the file cannot be opened.
        """
        make_private_directory(data_dir, FILE)
        lock = WriterLock.acquire(data_dir / LOCK_FILE, lock_timeout_s)
        make_private_file(data_dir / FILE)
        engine = engines.open_writer(data_dir / FILE, BUSY_TIMEOUT_S)
        try:
            upgrade(engine, "samples")
        except DBAPIError as error:
            lock.close()
            raise StoreError(f"cannot open {data_dir / FILE}: {error.orig}") from error
        except StoreError:
            engine.dispose()
            lock.close()
            raise
        return cls(lock, engine, FolderWatch(data_dir, FILE))

    def next_seq(self, run_id: str, stream: str) -> int:
        """Return the sequence number after the last stored row, 0 where there is none."""
        last = select(func.max(chunk.c.seq0 + chunk.c.n))
        with _reported("read samples"), self._engine.begin() as link:
            found = link.execute(last.where(chunk.c.run_id == run_id, chunk.c.stream == stream)).scalar()
        return int(found or 0)

    def is_closed(self, run_id: str) -> bool:
        """Return whether a run has been closed; nothing is added to it any more."""
        with _reported("read samples"), self._engine.begin() as link:
            return read_closed(link, run_id) is not None

    def commit(self, batch: Sequence[Rows]) -> None:
        """Store rows in one transaction; on return they are on the disk. A block already there stays as it is.

        Raises
        ------
        StoreError
            Nothing of the batch is stored, and nothing more can be: the disk is full or has failed, or the file that
            is written is not the one in the directory any more.
        """
        filled = [rows for rows in batch if rows.n]
        if not filled:
            return
        self._check_folder()
        if (room := self._watch.room(RESERVE_BYTES)).short:
            raise StoreError(f"cannot store samples: the disk is full ({room.in_words()}); {_UNTIL_IN_ORDER}")
        insert = engines.insert_new(self._engine, chunk, ("run_id", "stream", "seq0"))
        with _reported("store samples"), self._engine.begin() as link:
            link.execute(insert, [_record(rows, sealed=False) for rows in filled])
        self._check_folder()
        for rows in filled:
            fresh = self._fresh.setdefault((rows.run_id, rows.stream), _Fresh())
            t0, t1 = time_range(rows.columns)
            fresh.rows += rows.n
            fresh.t0, fresh.t1 = min(fresh.t0, t0), max(fresh.t1, t1)

    def _check_folder(self) -> None:
        """A file without a name takes everything and keeps nothing; looked at before and after each commit."""
        try:
            self._watch.check()
        except StoreError as error:
            raise StoreError(f"cannot store samples: {error.message}; {_UNTIL_IN_ORDER}") from error

    def seal_due(self) -> None:
        """Seal the streams that have gathered a full chunk, so that closing a run of days takes no longer.

        Raises
        ------
        StoreError
            As `commit`.
        """
        for (run_id, stream), fresh in list(self._fresh.items()):
            if fresh.rows >= SEALED_ROWS or fresh.t1 - fresh.t0 >= SEALED_S:
                with _reported("seal samples"), self._engine.begin() as link:
                    _seal_stream(link, run_id, stream)
                del self._fresh[run_id, stream]

    def close_run(self, run_id: str, state: str, reason: str | None) -> ClosedRun:
        """Seal a run's chunks and note its end, in one transaction; a run closed before keeps its first end.

        Raises
        ------
        StoreError
            As `commit`.
        """
        with _reported("seal samples"), self._engine.begin() as link:
            known = read_closed(link, run_id)
            if known is not None:
                return known
            streams = link.execute(select(chunk.c.stream).where(chunk.c.run_id == run_id).distinct())
            for stream in list(streams.scalars()):
                _seal_stream(link, run_id, stream)
            digest = stored_hash(link, run_id, self._watch.folder)
            closed = ClosedRun(run_id, state, reason, count_rows(link, run_id, SAMPLES), digest)
            link.execute(closed_run.insert().values(_closed_record(closed)))
        self._check_folder()
        for key in [key for key in self._fresh if key[0] == run_id]:
            del self._fresh[key]
        return closed

    def close(self) -> None:
        """Close the file and give the lock back."""
        self._engine.dispose()
        self._lock.close()


@contextmanager
def _reported(doing: str) -> Iterator[None]:
    """Turn a database error into a StoreError that says what was being done."""
    try:
        yield
    except DBAPIError as error:
        raise StoreError(f"cannot {doing}: {error.orig}; {_UNTIL_IN_ORDER}") from error


def _seal_stream(link: Connection, run_id: str, stream: str) -> None:
    where = (chunk.c.run_id == run_id, chunk.c.stream == stream, chunk.c.sealed.is_(False))
    found = link.execute(select(chunk).where(*where).order_by(chunk.c.seq0)).all()
    for group in _groups(found):
        _merge(link, run_id, stream, group)


def _groups(rows: Sequence[Row[Any]]) -> Iterable[list[Row[Any]]]:
    """Divide chunks into groups that fit in a sealed chunk and have no hole."""
    group: list[Row[Any]] = []
    for row in rows:
        if group and not _fits(group, row):
            yield group
            group = []
        group.append(row)
    if group:
        yield group


def _fits(group: list[Row[Any]], row: Row[Any]) -> bool:
    return (
        row.seq0 == group[-1].seq0 + group[-1].n
        and row.seq0 + row.n - group[0].seq0 <= SEALED_ROWS
        and row.t1 - group[0].t0 <= SEALED_S
    )


def _merge(link: Connection, run_id: str, stream: str, group: list[Row[Any]]) -> None:
    try:
        decoded = [decode(block_of(row)) for row in group]
    except BlockError as error:
        # Left as it is: the reader then names the chunk that is damaged, and the others stay readable.
        _LOG.error("not sealed: %s", describe(run_id, stream, group[0], error))
        return
    layout = decoded[0][0]
    if any(other != layout for other, _ in decoded):
        _LOG.error("not sealed: columns change within run %s, stream %s", run_id, stream)
        return
    columns = {c.name: np.concatenate([block[c.name] for _, block in decoded]) for c in layout}
    ids = [row.id for row in group]
    for start in range(0, len(ids), 500):  # databases limit the parameters of a statement
        link.execute(delete(chunk).where(chunk.c.id.in_(ids[start : start + 500])))
    merged = Rows(run_id, stream, group[0].seq0, layout, columns)
    link.execute(chunk.insert().values(_record(merged, sealed=True)))


def _record(rows: Rows, *, sealed: bool) -> dict[str, Any]:
    block = encode(rows.seq0, rows.layout, rows.columns)
    t0, t1 = time_range(rows.columns)
    return {
        "run_id": rows.run_id,
        "stream": rows.stream,
        "seq0": block.seq0,
        "n": block.n,
        "t0": t0,
        "t1": t1,
        "sealed": sealed,
        "codec": block.codec,
        "crc": block.crc,
        "data": block.data,
    }


def _closed_record(closed: ClosedRun) -> dict[str, Any]:
    now = datetime.now(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")
    return {
        "run_id": closed.run_id,
        "state": closed.state,
        "reason": closed.reason,
        "n_samples": closed.n_samples,
        "sha256": closed.sha256,
        "closed_utc": now,
    }
