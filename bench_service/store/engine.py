"""Opening the database files: one writing connection per file, any number of readers.

Rule: **one writing connection per file**, in one process, guarded by a lock file; all others open the file read-only.
Until 3.51.2 (fixed in 3.51.3; Debian 12 ships 3.40.1) SQLite could corrupt a WAL file when two connections wrote or
checkpointed at once (sqlite.org, "WAL-reset bug"); with a single writer that cannot happen. The lock is `flock` on a
file beside the database: it ends with the process, however that ends. A forked child would inherit it, so worker
processes must be started by ``spawn`` or ``subprocess``, never by ``fork``.

All SQL that only SQLite understands is in this file.
"""

import fcntl
import functools
import json
import os
import sqlite3
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Engine, Table, create_engine, event
from sqlalchemy.pool import QueuePool

from bench_service.errors import StoreError

# How long to wait for a foreign program that holds the file: somebody waits for an answer.
BUSY_TIMEOUT_S = 20.0
_POLL_S = 0.05
_PROBE_GRACE_S = 0.3
_OLDEST_SQLITE = (3, 35, 0)


@dataclass(frozen=True, slots=True)
class LockHolder:
    """The process that writes a database file: its process id and, for the API, the service's address."""

    pid: int | None
    url: str | None


class WriterLock:
    """The right to write one database file; held until `close` or the end of the process."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._descriptor = descriptor
        self.announce(None)

    @classmethod
    def acquire(cls, path: Path, timeout_s: float = 0.0) -> "WriterLock":
        """Take the lock file `path`, waiting up to `timeout_s` for its present holder to go.

        Raises
        ------
        StoreError
            Another process holds it, or the file cannot be written.
        """
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise StoreError(f"cannot create lock file {path}: {error.strerror}") from error
        # A probe by `lock_holder` holds the file for an instant and is no reason to give up.
        deadline = time.monotonic() + max(timeout_s, _PROBE_GRACE_S)
        while not _try_lock(descriptor, fcntl.LOCK_EX):
            if time.monotonic() >= deadline:
                holder = _read_holder(descriptor)
                os.close(descriptor)
                raise StoreError(_held_text(path, holder))
            time.sleep(_POLL_S)
        try:
            return cls(path, descriptor)
        except OSError as error:
            os.close(descriptor)
            raise StoreError(f"cannot write lock file {path}: {error.strerror}; see to the disk") from error

    def announce(self, url: str | None) -> None:
        """Write who holds the lock; `url` is the address where the service answers."""
        text = json.dumps({"pid": os.getpid(), "url": url}).encode()
        os.pwrite(self._descriptor, text, 0)
        os.ftruncate(self._descriptor, len(text))

    def close(self) -> None:
        """Give the lock back; the file stays, since removing it would race with the next holder."""
        if self._descriptor >= 0:
            os.ftruncate(self._descriptor, 0)
            os.close(self._descriptor)
            self._descriptor = -1


def lock_holder(path: Path) -> LockHolder | None:
    """Return who holds the lock file `path`, or None when nobody does."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        return None
    try:
        return None if _try_lock(descriptor, fcntl.LOCK_SH) else _read_holder(descriptor)
    finally:
        os.close(descriptor)


def open_writer(path: Path, busy_timeout_s: float = BUSY_TIMEOUT_S) -> Engine:
    """Return an engine with exactly one connection, which may write; the caller holds the file's lock.

    Threads that need the connection wait for each other. Every transaction takes the write lock at its begin and is
    on the disk when its commit returns (``synchronous=FULL``).

    Raises
    ------
    StoreError
        This SQLite is too old.
    """
    check_sqlite()
    engine = _engine(lambda: _connect(f"{path.absolute().as_uri()}?mode=rwc", busy_timeout_s), pool_size=1)
    event.listen(engine, "connect", _set_up_writer)
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN IMMEDIATE"))
    return engine


def open_reader(path: Path, pool_size: int = 4) -> Engine:
    """Return an engine whose connections can only read; keep its transactions short, for they hold back the WAL."""
    check_sqlite()
    engine = _engine(lambda: _connect(f"{path.absolute().as_uri()}?mode=ro"), pool_size=pool_size)
    event.listen(engine, "connect", _set_up_reader)
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN"))
    return engine


def faults_of(path: Path) -> list[str]:
    """Return what SQLite finds wrong with the structure of a file; nothing where it is sound."""
    try:
        with closing(_connect(f"{path.absolute().as_uri()}?mode=ro")) as connection:
            told = [str(row[0]) for row in connection.execute("PRAGMA quick_check(5)")]
    except sqlite3.DatabaseError as error:
        return [str(error)]
    return [] if told == ["ok"] else told


def compact(engine: Engine) -> None:
    """Give the room of deleted rows back to the disk; needs as much again for a while."""
    connection = engine.raw_connection()
    try:
        connection.cursor().execute("VACUUM")
        connection.cursor().execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
    finally:
        connection.close()


def check_sqlite() -> str:
    """Return the version of the SQLite library in use.

    Raises
    ------
    StoreError
        It is older than this service needs.
    """
    if sqlite3.sqlite_version_info < _OLDEST_SQLITE:
        needed = ".".join(map(str, _OLDEST_SQLITE))
        raise StoreError(f"SQLite {sqlite3.sqlite_version} is too old; {needed} or later is needed")
    return sqlite3.sqlite_version


def insert_new(engine: Engine, table: Table, keys: Sequence[str]) -> Any:
    """Return an INSERT that leaves a row alone where one with the same `keys` is already there."""
    # Each dialect takes 50 ms or more: only the one that is there is loaded.
    if engine.dialect.name == "postgresql":
        from sqlalchemy.dialects.postgresql import insert
    else:
        from sqlalchemy.dialects.sqlite import insert
    return insert(table).on_conflict_do_nothing(index_elements=list(keys))


def _engine(creator: Callable[[], sqlite3.Connection], pool_size: int) -> Engine:
    return create_engine(
        "sqlite://",
        json_serializer=functools.partial(json.dumps, allow_nan=False),
        creator=creator,
        poolclass=QueuePool,
        pool_size=pool_size,
        max_overflow=0,
        pool_timeout=30.0,
    )


def _connect(uri: str, busy_timeout_s: float = BUSY_TIMEOUT_S) -> sqlite3.Connection:
    # isolation_level=None: the module's own late BEGIN would leave schema changes outside transactions.
    return sqlite3.connect(uri, uri=True, timeout=busy_timeout_s, check_same_thread=False, isolation_level=None)


def _set_up_writer(connection: sqlite3.Connection, _record: object) -> None:
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=FULL")  # NORMAL was seen to lose acknowledged seconds at a power cut
    connection.execute("PRAGMA mmap_size=0")  # a disk error is then an error code, not a SIGBUS
    connection.execute("PRAGMA foreign_keys=ON")
    connection.execute(f"PRAGMA journal_size_limit={64 * 2**20}")


def _set_up_reader(connection: sqlite3.Connection, _record: object) -> None:
    connection.execute("PRAGMA mmap_size=0")
    connection.execute("PRAGMA query_only=ON")


def _try_lock(descriptor: int, kind: int) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _read_holder(descriptor: int) -> LockHolder:
    try:
        data = json.loads(os.pread(descriptor, 4096, 0))
        return LockHolder(int(data["pid"]), data.get("url"))
    except (ValueError, KeyError, TypeError):
        return LockHolder(None, None)  # taken this instant, not announced yet


def _held_text(path: Path, holder: LockHolder) -> str:
    who = f"process {holder.pid}" if holder.pid else "another process"
    where = f", service at {holder.url}" if holder.url else ""
    return f"{path.with_suffix('.sqlite')} is being written by {who}{where}; use that service, or end it first"
