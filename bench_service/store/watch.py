"""Whether the data directory is still the one that was opened, and how much room there is in it."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from bench_service.errors import StoreError

MEGABYTE = 10**6
# Kept free whatever runs: the end of a run must be written down, and a log merged, on a disk that a run has filled.
RESERVE_BYTES = 16 * MEGABYTE


def file_identity(path: Path) -> tuple[int, int] | None:
    """Return what tells a file or directory from every other of its name, None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


@dataclass(frozen=True, slots=True)
class Room:
    """Free space where the data are, and what it is held against, in bytes."""

    free: int
    floor: int

    @property
    def short(self) -> bool:
        """Whether there is less than there must be."""
        return self.free < self.floor

    def in_words(self) -> str:
        """Return both figures for a person."""
        return f"{self.free / MEGABYTE:.0f} MB free, floor {self.floor / MEGABYTE:.0f} MB"


class FolderWatch:
    """Files that are held open, and whether their names still lead to them.

    A removed file can be written for as long as it is open; what is written is lost with its last closing.

    Parameters
    ----------
    data_dir : Path
    *names : str
        Files in it that must stay the same; they must be there now.
    """

    def __init__(self, data_dir: Path, *names: str) -> None:
        self._data_dir = data_dir
        paths = (data_dir, *(data_dir / name for name in names))
        self._opened = {path: file_identity(path) for path in paths}

    @property
    def folder(self) -> Path:
        """The directory that holds them."""
        return self._data_dir

    def check(self) -> None:
        """Raise `StoreError` where the directory or a file is gone, or another has taken its place."""
        for path, opened in self._opened.items():
            found = file_identity(path)
            if found is None:
                raise StoreError(f"{path} is gone while the service writes it; put it back, or start the service again")
            if found != opened:
                raise StoreError(
                    f"{path} is not the one that the service has opened; put that back, or start the service again"
                )

    def room(self, floor: int) -> Room:
        """Return the free space of the directory.

        Raises
        ------
        StoreError
            It is gone, or cannot be asked.
        """
        try:
            return Room(shutil.disk_usage(self._data_dir).free, floor)
        except OSError as error:
            raise StoreError(f"cannot see how much room {self._data_dir} has: {error.strerror}") from error


def check_writable_folder(data_dir: Path) -> None:
    """Raise `StoreError` where nothing can be written to a directory, as on a disk that has become read-only."""
    probe = data_dir / ".probe"
    try:
        descriptor = os.open(probe, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            os.write(descriptor, b"\0" * 4096)
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise StoreError(f"cannot write to {data_dir}: {error.strerror}") from error
