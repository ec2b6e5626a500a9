"""Write a file whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from bench_service.exchange.errors import ExchangeError


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; as `atomic_file`, for what fits into memory."""
    with atomic_file(path) as stream:
        stream.write(content)


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Write a temporary file beside `path`, flush it to the disk, and put it in place by renaming.

    Yields the stream to write to; after an error in the body nothing is left of it.

    Raises
    ------
    ExchangeError
        The directory is missing or cannot be written; an older file of that name is untouched.
    """
    try:
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise _refusal(path, error) from error
    try:
        with os.fdopen(descriptor, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o666 & ~_umask())  # a temporary file is readable by its owner only
        os.replace(temporary, path)
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise _refusal(path, error) from error
        raise
    _sync_directory(path.parent)


def check_writable(path: Path) -> None:
    """Refuse an output early, before hours of work whose result could not be written.

    Raises
    ------
    ExchangeError
        The directory is missing or not writable, or `path` is a directory.
    """
    if path.is_dir():
        raise ExchangeError(f"{path}: is a directory; name a file")
    if not path.parent.is_dir():
        raise ExchangeError(f"{path}: the directory {path.parent} does not exist; create it first")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise ExchangeError(f"{path}: the directory {path.parent} is not writable")


def _refusal(path: Path, error: OSError) -> ExchangeError:
    return ExchangeError(f"{path}: cannot be written: {error.strerror or error}")


def _umask() -> int:
    # The mask can only be read by setting it.
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def _sync_directory(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
