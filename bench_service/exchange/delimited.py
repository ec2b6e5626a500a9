"""Text tables: read by pyarrow, written so that reading gives the same bits back."""

from __future__ import annotations

import csv
import gzip
import io
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.arrow_numbers import floats, table_of
from bench_service.exchange.errors import ExchangeError
from bench_service.exchange.format import Array

_GZIP_MAGIC = b"\x1f\x8b"
_MISSING = ["", "NaN", "nan", "NAN", "NA", "N/A", "null", "None"]
_LONGEST_HEADER_BYTES = 65536

Chooser = Callable[[list[str]], dict[str, str]]
# Bytes from which on several threads read. In a small file they save nothing, and a program that ends at once, because
# the file is refused, has been seen to abort while its threads were still starting.
_WORTH_THREADS = 1_000_000


def is_text_table(head: bytes) -> bool:
    """Whether a file's first bytes look like text (or gzip, whose content is looked at when it is read)."""
    return head.startswith(_GZIP_MAGIC) or (b"\x00" not in head and not head.startswith(b"PAR1"))


def read_columns(
    path: Path, choose: Chooser, error: type[ExchangeError]
) -> tuple[tuple[str, ...], dict[str, NDArray[np.float64]]]:
    """Read the chosen numeric columns of a CSV or gzipped CSV file.

    Parameters
    ----------
    path : the file
    choose : from the header's names to own name -> name in the file; raises where columns are wrong
    error : what to raise

    Returns
    -------
    tuple
        All names of the header, and own name -> (n,) float64 with NaN for empty fields.
    """
    # Lazy: pyarrow takes 30 ms.
    import pyarrow as pa
    import pyarrow.csv as pa_csv

    names, delimiter = _header(path, error)
    chosen = choose(names)
    positions = [str(k) for k in range(len(names))]
    wanted = {own: positions[names.index(name)] for own, name in chosen.items()}
    convert = pa_csv.ConvertOptions(
        column_types={position: pa.float64() for position in wanted.values()},
        include_columns=list(wanted.values()),
        null_values=_MISSING,
        quoted_strings_can_be_null=True,
    )
    try:
        with _open(path) as stream:
            table = pa_csv.read_csv(
                stream,
                read_options=pa_csv.ReadOptions(
                    column_names=positions, skip_rows=1, use_threads=path.stat().st_size > _WORTH_THREADS
                ),
                parse_options=pa_csv.ParseOptions(delimiter=delimiter),
                convert_options=convert,
            )
    except (pa.ArrowException, OSError, EOFError) as cause:
        raise error(f"{path}: {_explain(path, cause, names, chosen, delimiter)}") from cause
    return tuple(names), {own: floats(table.column(at)) for own, at in wanted.items()}


def encode_csv(columns: Mapping[str, Array]) -> bytes:
    """Write columns as CSV; numbers in the shortest form that reads back to the same bits, NaN as empty field."""
    # Lazy: pyarrow takes 20 ms.
    import pyarrow.csv as pa_csv

    table = table_of({str(k): values for k, values in enumerate(columns.values())})
    sink = io.BytesIO()
    # The header is written here: pyarrow would put every label into quotation marks.
    csv.writer(sink_text := io.StringIO(), lineterminator="\n").writerow(columns)
    sink.write(sink_text.getvalue().encode())
    pa_csv.write_csv(table, sink, pa_csv.WriteOptions(include_header=False))
    return sink.getvalue()


def _open(path: Path) -> BinaryIO:
    raw = path.open("rb")
    if raw.read(2) != _GZIP_MAGIC:
        raw.seek(0)
        return raw
    raw.close()
    return cast(BinaryIO, gzip.open(path, "rb"))


def _header(path: Path, error: type[ExchangeError]) -> tuple[list[str], str]:
    try:
        with _open(path) as stream:
            line = stream.readline(_LONGEST_HEADER_BYTES)
    except (OSError, EOFError) as cause:
        raise error(f"{path}: cannot be read: {_plain(cause)}") from cause
    if not line.strip():
        raise error(f"{path}: is empty; a header line with column names is needed")
    try:
        text = line.decode("utf-8-sig").strip("\r\n")
    except UnicodeDecodeError as cause:
        raise error(f"{path}: is not a CSV file: its first line is no UTF-8 text") from cause
    if "\x00" in text:
        raise error(f"{path}: is not a CSV file: its first line holds binary data")
    delimiter = max((",", ";", "\t"), key=text.count)
    try:
        names = [name.strip() for name in next(csv.reader([text], delimiter=delimiter))]
    except csv.Error as cause:
        raise error(f"{path}: is not a CSV file: its first line cannot be read ({cause})") from cause
    for k, name in enumerate(names):
        if name in names[:k]:
            raise error(f"{path}: column {name!r} appears twice")
    return names, delimiter


def _plain(cause: BaseException) -> str:
    """First line of a library's message, without what it says about itself."""
    reason = cause.strerror if isinstance(cause, OSError) and cause.strerror else str(cause)
    return (reason or type(cause).__name__).splitlines()[0]


def _explain(path: Path, cause: BaseException, names: list[str], chosen: Mapping[str, str], delimiter: str) -> str:
    """Find the row that the fast reader refused; slow, but only for files that are refused."""
    wanted = {names.index(name): name for name in chosen.values()}
    try:
        with _open(path) as stream, io.TextIOWrapper(stream, encoding="utf-8-sig", newline="") as text:
            for row, cells in enumerate(csv.reader(text, delimiter=delimiter), start=1):
                if row == 1 or not cells:
                    continue
                if len(cells) != len(names):
                    return f"row {row} has {len(cells)} fields, the header has {len(names)}"
                for k, name in wanted.items():
                    if not _is_number(cells[k]):
                        return f"row {row}, column {name!r}: {cells[k][:40]!r} is not a number"
    except (OSError, EOFError, UnicodeDecodeError, csv.Error) as other:
        return f"cannot be read: {_plain(other)}"
    if "Empty CSV" in str(cause):
        return "has a header but no rows"
    return f"cannot be read: {_plain(cause)}"


def _is_number(cell: str) -> bool:
    if cell in _MISSING:
        return True
    try:
        return not math.isnan(float(cell))
    except ValueError:
        return False
