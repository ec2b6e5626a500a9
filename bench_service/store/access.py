"""The metadata file: opening it, its one writing connection, its readers."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import Column, Connection, Engine, Row, Select, Table, func, select
from sqlalchemy.exc import DBAPIError, IntegrityError, StatementError

from bench_service.errors import ConflictError, NotFoundError, StoreError
from bench_service.store import engine as engines
from bench_service.store.engine import WriterLock
from bench_service.store.migrate import check_revision, upgrade
from bench_service.store.private import make_private_directory, make_private_file

FILE = "meta.sqlite"
LOCK_FILE = "meta.lock"


class MetadataFile:
    """``meta.sqlite`` of a data directory, opened for writing; for several threads.

    Every method raises `StoreError` where the database fails.
    """

    def __init__(self, lock: WriterLock | None, writer: Engine, reader: Engine) -> None:
        self.lock = lock
        self._writer = writer
        self._reader = reader

    @classmethod
    def open(cls, data_dir: Path, lock_timeout_s: float) -> "MetadataFile":
        """Open or create the file, and bring it to the present schema.

        Raises
        ------
        StoreError
            Another process writes it (the message names it), or it cannot be opened.
        """
        make_private_directory(data_dir, FILE)
        lock = WriterLock.acquire(data_dir / LOCK_FILE, lock_timeout_s)
        make_private_file(data_dir / FILE)
        writer = engines.open_writer(data_dir / FILE)
        try:
            with _reported(f"open {data_dir / FILE}"):
                upgrade(writer, "meta")
        except StoreError:
            writer.dispose()
            lock.close()
            raise
        return cls(lock, writer, engines.open_reader(data_dir / FILE))

    @classmethod
    def look(cls, data_dir: Path) -> "MetadataFile":
        """Open the file for reading alone, also while another process writes it.

        Raises
        ------
        StoreError
            It is not there, or of another version than this one.
        """
        if not (data_dir / FILE).exists():
            raise StoreError(f"nothing is stored in {data_dir}")
        reader = engines.open_reader(data_dir / FILE)
        with _reported(f"open {data_dir / FILE}"):
            check_revision(reader, "meta")
        return cls(None, reader, reader)

    def close(self) -> None:
        """Close the file and give the lock back."""
        self._reader.dispose()
        self._writer.dispose()
        if self.lock is not None:
            self.lock.close()

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """Give the writing connection, in a transaction that is on the disk when the block ends."""
        with _reported("write the metadata"), self._writer.begin() as link:
            yield link

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """Give a reading connection, in a transaction."""
        with _reported("read the metadata"), self._reader.begin() as link:
            yield link

    def insert(self, table: Table, values: dict[str, Any]) -> Any:
        """Insert one row; return its key. Where rows are numbered it gets the next number."""
        if "number" in table.c:
            last = select(func.coalesce(func.max(table.c.number), 0)).scalar_subquery()
            values = values | {"number": last + 1}
        with self.write() as link:
            key = link.execute(table.insert().values(values)).inserted_primary_key
        return key[0] if key else None

    def one(self, table: Table, query: Select[*tuple[Any, ...]], key: str | int) -> Row[Any]:
        """Return the row of `query` whose id is `key`.

        Raises
        ------
        NotFoundError
            There is none.
        """
        with self.read() as link:
            row = link.execute(query.where(table.c.id == key)).one_or_none()
        if row is None:
            raise NotFoundError.of(table.name, str(key))
        return row

    def page(
        self, table: Table, query: Select[*tuple[Any, ...]], limit: int, offset: int, after: int | None = None
    ) -> Sequence[Row[Any]]:
        """Return rows of `query`, what was inserted last first; with `after` those inserted before that `place`."""
        key = _place(table)
        ordered = query.order_by(key.desc())
        if after is not None:
            ordered = ordered.where(key < after)
        with self.read() as link:
            return link.execute(ordered.limit(limit).offset(offset)).all()

    def place(self, table: Table, key: Any) -> int:
        """Return where a row stands in the order of insertion: it stays so, whatever comes or goes.

        Raises
        ------
        NotFoundError
            There is none.
        """
        return int(self.one(table, select(_place(table)), key)[0])


def matching(table: Table, **wanted: str | None) -> Select[*tuple[Any, ...]]:
    """Query all rows of a table whose columns have the wanted values; None wants nothing."""
    return select(table).where(*(table.c[name] == value for name, value in wanted.items() if value is not None))


def _place(table: Table) -> Column[int]:
    return table.c.number if "number" in table.c else table.c.id


@contextmanager
def _reported(doing: str) -> Iterator[None]:
    try:
        yield
    except IntegrityError as error:
        raise ConflictError(f"cannot {doing}: {error.orig}") from error
    except (DBAPIError, StatementError) as error:
        raise StoreError(f"cannot {doing}: {error.orig}") from error
