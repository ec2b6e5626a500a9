"""Data that only their owner can read: directories 0700, files 0600."""

import contextlib
import os
from pathlib import Path

from bench_service.errors import StoreError

DIRECTORY_MODE, FILE_MODE = 0o700, 0o600


def make_private_directory(path: Path, *holding: str) -> None:
    """Make a directory that only its owner can enter; one that is there is closed to others if it is ours alone.

    Parameters
    ----------
    path : Path
    *holding : str
        Files by which a directory that is there already is known to be a data directory: somebody's home, in which the
        service was started by mistake, is left as it is.

    Raises
    ------
    StoreError
        It cannot be made.
    """
    try:
        if path.is_dir():
            ours = any((path / name).exists() for name in holding) or not any(path.iterdir())
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.mkdir(mode=DIRECTORY_MODE, exist_ok=True)
            ours = True
    except OSError as error:
        raise StoreError(f"cannot create data directory {path}: {error.strerror}") from error
    if ours:
        with contextlib.suppress(OSError):  # a file system without owners, or another owner's directory
            path.chmod(DIRECTORY_MODE)


def make_private_file(path: Path) -> None:
    """Make a file that only its owner can read, or make one so that is there; SQLite's logs follow their database."""
    with contextlib.suppress(OSError):  # whoever opens it says what is wrong
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, FILE_MODE)
        try:
            os.fchmod(descriptor, FILE_MODE)
        finally:
            os.close(descriptor)
    for log in (path.with_name(path.name + "-wal"), path.with_name(path.name + "-shm")):
        with contextlib.suppress(OSError):
            log.chmod(FILE_MODE)
