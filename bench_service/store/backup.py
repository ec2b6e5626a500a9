"""Copies of a data directory, taken while it is written and put back where nobody writes.

A copy is a directory with both databases and a manifest that says what each file hashes to. SQLite copies page by page
out of one read transaction each: metadata first, so that every run that their copy knows as ended has its samples in
the other.
"""

import hashlib
import json
import os
import shutil
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from bench_service.errors import ConflictError, StoreError
from bench_service.store.access import FILE as META_FILE
from bench_service.store.metadata import MetadataStore
from bench_service.store.private import DIRECTORY_MODE, FILE_MODE
from bench_service.store.records import Json, utc_text
from bench_service.store.samples import FILE as SAMPLES_FILE
from bench_service.store.verify import Report, verify

MANIFEST = "manifest.json"
_PAGES_AT_ONCE = 1000
_HASH_BYTES = 2**20


@dataclass(frozen=True, slots=True)
class Backup:
    """A copy that was taken or put back."""

    path: Path
    n_bytes: int
    report: Report

    def to_json(self) -> Json:
        """Return a JSON object."""
        state = "damaged" if self.report.damaged else "whole"
        counts = {"runs": self.report.n_runs, "samples": self.report.n_samples}
        return {"file": str(self.path), "bytes": self.n_bytes, "state": state} | counts


def take(data_dir: Path, target: Path) -> Backup:
    """Copy a data directory, also while a service writes it; whole or not at all.

    Raises
    ------
    ConflictError
        There is something at `target` already.
    StoreError
        There is no store, or the copy cannot be written or read back.
    """
    if target.exists():
        raise ConflictError(f"{target} is there already; name a new directory for the copy")
    if not (data_dir / META_FILE).exists():
        raise StoreError(f"nothing is stored in {data_dir}")
    made = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        made.mkdir(mode=DIRECTORY_MODE, parents=True)
        for name in (META_FILE, SAMPLES_FILE):
            if (data_dir / name).exists():
                _copy(data_dir / name, made / name)
        for name in ("seals", "damaged"):
            if (data_dir / name).is_dir():
                shutil.copytree(data_dir / name, made / name)
        (made / MANIFEST).write_text(json.dumps(_manifest(made), indent=1) + "\n")
        (made / MANIFEST).chmod(FILE_MODE)
        report = verify(made)
        made.rename(target)
    except (OSError, sqlite3.Error) as error:
        raise StoreError(f"cannot copy {data_dir} to {target}: {error}") from error
    finally:
        shutil.rmtree(made, ignore_errors=True)
    return Backup(target, _size(target), report)


def put_back(source: Path, data_dir: Path) -> Backup:
    """Make a data directory from a copy; nobody may have it, and it must hold nothing yet.

    Raises
    ------
    ConflictError
        A service has the directory, or something is stored in it.
    StoreError
        The copy is not whole, or cannot be read or written.
    """
    if MetadataStore.holder(data_dir) is not None:
        raise ConflictError(f"a service has {data_dir} open; end it first")
    if (data_dir / META_FILE).exists() or (data_dir / SAMPLES_FILE).exists():
        raise ConflictError(f"{data_dir} holds data already; move it away, or name another with --config")
    _check(source)
    made = data_dir.with_name(f".{data_dir.name}.{os.getpid()}")
    try:
        shutil.copytree(source, made)
        made.chmod(DIRECTORY_MODE)
        (made / MANIFEST).unlink()
        report = verify(made)
        if data_dir.is_dir():
            for path in made.iterdir():
                path.rename(data_dir / path.name)
        else:
            made.rename(data_dir)
    except OSError as error:
        raise StoreError(f"cannot put {source} back to {data_dir}: {error}") from error
    finally:
        shutil.rmtree(made, ignore_errors=True)
    return Backup(data_dir, _size(data_dir), report)


def _copy(source: Path, target: Path) -> None:
    os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL, FILE_MODE))
    with closing(sqlite3.connect(f"{source.absolute().as_uri()}?mode=ro", uri=True)) as reader:
        with closing(sqlite3.connect(target)) as writer:
            reader.execute("BEGIN")  # all pages of one moment, however long the copy takes
            reader.execute("SELECT count(*) FROM sqlite_master").fetchone()
            reader.backup(writer, pages=_PAGES_AT_ONCE)
            writer.execute("PRAGMA journal_mode=DELETE")
    descriptor = os.open(target, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _manifest(folder: Path) -> Json:
    files = {name: _sha256(folder / name) for name in (META_FILE, SAMPLES_FILE) if (folder / name).exists()}
    return {"kind": "bench-service backup", "taken_utc": utc_text(datetime.now(UTC)), "files": files}


def _check(source: Path) -> None:
    try:
        manifest = json.loads((source / MANIFEST).read_text())
        files = dict(manifest["files"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StoreError(f"{source} is no copy of a data directory: {error}") from error
    for name, expected in files.items():
        if not (source / name).is_file() or _sha256(source / name) != expected:
            raise StoreError(f"{source / name} is not as it was copied: its content has another hash")


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while part := file.read(_HASH_BYTES):
            digest.update(part)
    return digest.hexdigest()


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
