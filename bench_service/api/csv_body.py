"""A CSV body, read by the same reader as a CSV file."""

from __future__ import annotations

import tempfile
from pathlib import Path

from bench_service.errors import BadRequestError
from bench_service.exchange.errors import ProfileFileError
from bench_service.exchange.profile import ProfileFile, read_profile

_GZIP_MAGIC = b"\x1f\x8b"


def read_csv_profile(body: bytes) -> ProfileFile:
    """Read a profile from the bytes of a CSV file.

    Raises
    ------
    BadRequestError
        Compressed (a small body could hold gigabytes), or no profile; the message names the row.
    """
    if body.startswith(_GZIP_MAGIC):
        raise BadRequestError("the CSV is compressed; send it plain")
    with tempfile.TemporaryDirectory(prefix="bench-profile-") as directory:
        path = Path(directory) / "profile.csv"
        path.write_bytes(body)
        try:
            return read_profile(path)
        except ProfileFileError as error:
            raise BadRequestError(str(error).replace(str(path), "profile.csv")) from error
