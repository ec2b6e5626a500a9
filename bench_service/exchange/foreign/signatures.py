"""What a file is, by its first bytes; and for what cannot be read here, the export to make instead."""

from __future__ import annotations

import zipfile
from pathlib import Path

from bench_service.exchange.errors import RunFileError

_HEAD_BYTES = 4096
GZIP = b"\x1f\x8b"

# First bytes -> what that is and what to do instead.
_REFUSED: tuple[tuple[bytes, str], ...] = (
    (
        b"BIO-LOGIC MODULAR FILE",
        "a BioLogic .mpr file, whose readers have another licence: in EC-Lab or BT-Lab choose "
        "Experiment > Export as Text (.mpt or .txt) and import that, or name a reader in [readers] of bench.toml",
    ),
    (
        b"\x00\x01\x00\x00Standard Jet DB",
        "an Arbin .res file (an Access database): export it as CSV with Arbin's Data Watcher or MITS Pro, or its "
        "Channel_Normal_Table with mdb-export, and import that, or name a reader in [readers] of bench.toml",
    ),
    (
        b"\x00\x01\x00\x00Standard ACE DB",
        "an Access database: export the table of samples as CSV and import that",
    ),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an Excel 97 file (.xls): save its table of samples as CSV and import that"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file: write its samples as CSV or Parquet and import that"),
    (b"%PDF", "a PDF, not a table of samples"),
    (b"\x89PNG", "a picture, not a table of samples"),
    (b"\xff\xd8\xff", "a picture, not a table of samples"),
    (b"SQLite format 3", "a SQLite database: export the table of samples as CSV and import that"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive: unpack it and import the file inside"),
    (b"Rar!", "a RAR archive: unpack it and import the file inside"),
    (b"BZh", "a bzip2 file: unpack it and import what is inside"),
    (b"\xfd7zXZ", "an xz file: unpack it and import what is inside"),
    (b"\x28\xb5\x2f\xfd", "a zstd file: unpack it and import what is inside"),
    (b"{", "JSON, not a table of samples: a protocol or a model is given to the command that takes it"),
)


def kind_of(path: Path) -> str:
    """Tell what reads a file: ``text``, ``parquet``, ``neware``, ``mat`` or ``mdf``.

    Raises
    ------
    RunFileError
        Missing or empty file, or a kind that cannot be read here: with the export to make instead.
    """
    head = _head(path)
    if head.startswith(GZIP):
        head = _head_inside(path)
    for magic, what in _REFUSED:
        if head.startswith(magic):
            raise RunFileError(f"{path}: is {what}")
    if head.startswith(b"PAR1"):
        return "parquet"
    if head.startswith(b"NEWARE"):
        return "neware"
    if head.startswith(b"MATLAB 5.0 MAT-file"):
        return "mat"
    if head.startswith((b"MDF     ", b"UnFinMF ")):
        return "mdf"
    if head.startswith(b"PK\x03\x04"):
        return _kind_of_zip(path)
    return "text"


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
    except OSError as error:
        reason = "no such file" if isinstance(error, FileNotFoundError) else error.strerror or str(error)
        raise RunFileError(f"{path}: {reason[0].lower()}{reason[1:]}") from error
    if not head:
        raise RunFileError(f"{path}: is empty")
    return head


def _head_inside(path: Path) -> bytes:
    """First bytes of what was gzipped; binary formats are not looked for deeper than that."""
    # Lazy: few files need it.
    import gzip
    import zlib

    try:
        with gzip.open(path, "rb") as stream:
            head = stream.read(_HEAD_BYTES)
    except (OSError, EOFError, zlib.error) as error:
        raise RunFileError(f"{path}: is a damaged or cut gzip file: {error}") from error
    if head.startswith((b"PAR1", b"NEWARE", b"PK\x03\x04", b"MATLAB 5.0", b"MDF     ")):
        raise RunFileError(f"{path}: is a gzipped binary file: unpack it first (gunzip)")
    if not head:
        raise RunFileError(f"{path}: is empty inside its gzip wrapping")
    return head


def _kind_of_zip(path: Path) -> str:
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise RunFileError(f"{path}: is a damaged or cut zip file (.ndax, .xlsx): {error}") from error
    if any(name.endswith(".ndc") for name in names):
        return "neware"
    if "[Content_Types].xml" in names:
        raise RunFileError(f"{path}: is an Excel file (.xlsx): save its table of samples as CSV and import that")
    raise RunFileError(f"{path}: is a zip archive: unpack it and import the file inside")
