"""Reading samples: any process may do this, while the recorder writes."""

import logging
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from sqlalchemy import Connection, CursorResult, Engine, Row, Select, func, select
from sqlalchemy.exc import DBAPIError

from bench_service.errors import StoreError
from bench_service.store import engine as engines
from bench_service.store.blocks import BlockError, decode
from bench_service.store.intact import block_of, check_times, read_intact
from bench_service.store.reading import Assembler, StreamData
from bench_service.store.schema import chunk, closed_run
from bench_service.store.watch import file_identity
from bench_service.streams import SAMPLES, content_hash

FILE = "samples.sqlite"
LOCK_FILE = "samples.lock"
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ClosedRun:
    """What the recorder knows of a run that is over.

    Attributes
    ----------
    run_id, state, reason : str
        As the control process closed it; ``"interrupted"`` where that process died.
    n_samples : int
    sha256 : str or None
        Content hash of the stream ``samples``; None where a chunk is damaged.
    """

    run_id: str
    state: str
    reason: str | None
    n_samples: int
    sha256: str | None


class SampleReader:
    """Read access to the samples of one data directory; may be used from several threads."""

    def __init__(self, data_dir: Path) -> None:
        self._path = data_dir / FILE
        self._engine: Engine | None = None
        self._file: tuple[int, int] | None = None
        self._opening = threading.Lock()

    def __enter__(self) -> Self:
        """Return self."""
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _value: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def read(
        self, run_id: str, stream: str = SAMPLES, from_s: float | None = None, to_s: float | None = None
    ) -> StreamData:
        """Return a stream of a run, or its rows with ``from_s <= time_s <= to_s``.

        Rows of sealed and of fresh chunks are returned alike. A run without rows gives no columns. A chunk that
        cannot be read is logged and becomes a gap that names run, stream and chunk.

        Raises
        ------
        StoreError
            The file cannot be read at all.
        """
        return self._query(StreamData.empty(), lambda link: read_stream(link, run_id, stream, from_s, to_s))

    def n_rows(self, run_id: str, stream: str = SAMPLES) -> int:
        """Return how many rows of a stream are stored."""
        return self._query(0, lambda link: count_rows(link, run_id, stream))

    def counts(self) -> dict[str, int]:
        """Return how many samples of each run are stored."""
        query = select(chunk.c.run_id, func.sum(chunk.c.n)).where(chunk.c.stream == SAMPLES).group_by(chunk.c.run_id)
        return self._query({}, lambda link: {run_id: int(n) for run_id, n in link.execute(query)})

    def content_hash(self, run_id: str) -> str:
        """Return the content hash of a run's samples, computed anew from what is stored.

        Raises
        ------
        StoreError
            A chunk is damaged.
        """
        data = self.read(run_id)
        if data.damaged:
            raise StoreError(f"run {run_id} has no content hash: {_damage(data)}", ("run", run_id))
        return content_hash(data.columns)

    def closed(self, run_id: str) -> ClosedRun | None:
        """Return how a run was closed, or None where it was not, or not yet."""
        return self._query(None, lambda link: read_closed(link, run_id))

    def close(self) -> None:
        """Close the connections."""
        if self._engine is not None:
            self._engine.dispose()
            self._engine = None

    def _query(self, absent: Any, query: Any) -> Any:
        if (engine := self._present()) is None:
            return absent
        try:
            with engine.begin() as link:
                return query(link)
        except DBAPIError as error:
            raise StoreError(f"cannot read {self._path}: {error.orig}") from error

    def _present(self) -> Engine | None:
        """Return the engine of the file that is there now; one that has been removed reads well for ever."""
        found = file_identity(self._path)
        if found is None:
            if self._engine is not None:
                raise StoreError(f"{self._path} is gone; put the data folder back, or end the service")
            return None  # before the first recorder there is no file: that is an empty store, no error
        with self._opening:
            if self._engine is None or found != self._file:
                self.close()
                self._engine, self._file = engines.open_reader(self._path), found
            return self._engine


def read_stream(
    link: Connection, run_id: str, stream: str, from_s: float | None = None, to_s: float | None = None
) -> StreamData:
    """Return a stream of a run over an open connection; see `SampleReader.read`."""
    where = [chunk.c.run_id == run_id, chunk.c.stream == stream]
    if from_s is not None:
        where.append(chunk.c.t1 >= from_s)
    if to_s is not None:
        where.append(chunk.c.t0 <= to_s)
    capacity = link.execute(select(func.coalesce(func.sum(chunk.c.n), 0)).where(*where)).scalar_one()
    # Rows are numbered from 0, so that a missing start shows; within a time range the first row is not known.
    first = 0 if from_s is None else None
    chunks = _chunks().where(*where).order_by(chunk.c.seq0)
    link = link.execution_options(yield_per=16)
    with link.execute(chunks) as found:
        data = read_intact(found, int(capacity), first)
    if data is None:
        assembler = Assembler(int(capacity), first)
        _assemble(assembler, link.execute(chunks), run_id, stream)
        data = assembler.result()
    return data.between(from_s, to_s)


def chunks_of(link: Connection, run_id: str, stream: str) -> CursorResult[Any]:
    """Chunks of a stream in the order of their rows, a few at a time; to be closed."""
    query = _chunks().where(chunk.c.run_id == run_id, chunk.c.stream == stream).order_by(chunk.c.seq0)
    return link.execution_options(yield_per=16).execute(query)


def count_rows(link: Connection, run_id: str, stream: str) -> int:
    """Return how many rows of a stream are stored."""
    query = select(func.coalesce(func.sum(chunk.c.n), 0))
    return int(link.execute(query.where(chunk.c.run_id == run_id, chunk.c.stream == stream)).scalar_one())


def read_closed(link: Connection, run_id: str) -> ClosedRun | None:
    """Return how a run was closed, or None."""
    row = link.execute(select(closed_run).where(closed_run.c.run_id == run_id)).one_or_none()
    return None if row is None else ClosedRun(row.run_id, row.state, row.reason, row.n_samples, row.sha256)


def describe(run_id: str, stream: str, row: Row[Any], error: BlockError) -> str:
    """Return the text that names a damaged chunk."""
    last = row.seq0 + row.n - 1
    return f"run {run_id}, stream {stream}, chunk {row.id} (rows {row.seq0} to {last}): {error}"


def _chunks() -> Select[*tuple[Any, ...]]:
    names = ("id", "seq0", "n", "t0", "t1", "codec", "crc", "data")
    return select(*(chunk.c[name] for name in names))


def _assemble(assembler: Assembler, rows: Iterable[Row[Any]], run_id: str, stream: str) -> None:
    for row in rows:
        try:
            layout, columns = decode(block_of(row))
            check_times(row, columns)
        except BlockError as error:
            text = describe(run_id, stream, row, error)
            _LOG.error("damaged chunk: %s", text)
            assembler.add_damaged(row.seq0, row.n, text)
        else:
            assembler.add(row.seq0, row.n, layout, columns)


def _damage(data: StreamData) -> str:
    return "; ".join(gap.reason for gap in data.gaps if gap.reason != "missing")
