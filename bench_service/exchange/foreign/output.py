"""An imported run to a file, block by block, whole or not at all."""

from __future__ import annotations

import io
from pathlib import Path
from typing import BinaryIO

import numpy as np

from bench_service.exchange.arrow_numbers import table_of
from bench_service.exchange.atomic import atomic_file
from bench_service.exchange.columns import BDF_NAMES, COUNT_NAMES, UNIX_TIME_LABEL
from bench_service.exchange.delimited import encode_csv
from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.importing import Imported
from bench_service.exchange.foreign.spool import Columns
from bench_service.exchange.format import Array
from bench_service.streams import cell_number

SUFFIXES = (".bdf.csv", ".bdf.parquet", ".csv", ".parquet")


def check_suffix(path: Path) -> None:
    """Refuse a name whose end tells no format."""
    if not path.name.endswith(SUFFIXES):
        raise RunFileError(f"{path}: the end of its name must tell the format: {', '.join(SUFFIXES)}")


def write_imported(path: Path, run: Imported) -> None:
    """Write a run as CSV or Parquet with our own names or Battery Data Format labels, as the file's name ends."""
    check_suffix(path)
    labelled = ".bdf." in path.name
    with atomic_file(path) as stream:
        if path.name.endswith(".parquet"):
            _write_parquet(stream, run, labelled)
        else:
            _write_csv(stream, run, labelled)


def _write_csv(stream: BinaryIO, run: Imported, labelled: bool) -> None:
    header = True
    for block in run.blocks():
        if not len(block["time_s"]):
            continue
        content = encode_csv(_named(block, run, labelled))
        stream.write(content if header else content[content.index(b"\n") + 1 :])
        header = False


def _write_parquet(stream: BinaryIO, run: Imported, labelled: bool) -> None:
    # Lazy: pyarrow takes 40 ms.
    import pyarrow as pa
    import pyarrow.parquet as pq

    writer: pq.ParquetWriter | None = None
    # pyarrow closes what it writes to; the file is still to be flushed to the disk.
    sink = pa.PythonFile(_Unclosed(stream), mode="w")
    for block in run.blocks():
        columns = _named(block, run, labelled)
        table = table_of(columns)
        writer = writer or pq.ParquetWriter(sink, table.schema, compression="zstd")
        writer.write_table(table)
    if writer is not None:
        writer.close()


class _Unclosed(io.RawIOBase):
    """A stream that stays open when pyarrow closes it."""

    def __init__(self, stream: BinaryIO) -> None:
        super().__init__()
        self._stream = stream

    def writable(self) -> bool:
        """Say that it can be written."""
        return True

    def write(self, content: object) -> int:
        """Hand on."""
        return self._stream.write(content)  # pyright: ignore

    def tell(self) -> int:
        """Where it stands."""
        return self._stream.tell()


def _named(block: Columns, run: Imported, labelled: bool) -> dict[str, Array]:
    """Columns as they are written: counts as whole numbers, under our names or Battery Data Format labels.

    That format has no state of charge.
    """
    whole = {own: run.spool.missing[own] == 0 for own in COUNT_NAMES if own in block}
    columns: dict[str, Array] = {
        own: values.astype(np.int64) if whole.get(own) else values for own, values in block.items()
    }
    if not labelled:
        return columns
    labels = {own: label for own, (label, _) in BDF_NAMES.items()} | COUNT_NAMES
    named = {label: columns[own] for own, label in labels.items() if own in columns}
    named |= {
        own: values for own, values in columns.items() if cell_number(own) is not None
    }  # it has no label for them
    if run.started_unix_s is not None:
        named[UNIX_TIME_LABEL] = run.started_unix_s + block["time_s"]
    return named
