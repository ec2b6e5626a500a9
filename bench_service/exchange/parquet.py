"""Apache Parquet: read by Battery Data Format label or own name, written with own names."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

from bench_service.exchange.arrow_numbers import floats, table_of
from bench_service.exchange.columns import choose_columns
from bench_service.exchange.errors import RunFileError
from bench_service.exchange.format import Array, Format, RawTable, RunTable


def _recognise(head: bytes) -> bool:
    return head.startswith(b"PAR1")


def _read(path: Path) -> RawTable:
    # Lazy: pyarrow takes 40 ms.
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            names = tuple(file.schema_arrow.names)
            chosen = choose_columns(str(path), names)
            table = file.read(columns=list(chosen.values()))
    except (pa.ArrowException, OSError) as cause:
        reason = str(cause).splitlines()[0]
        raise RunFileError(f"{path}: is not a readable Parquet file: {reason}") from cause
    columns = {}
    for own, name in chosen.items():
        column = table.column(name)
        kind = column.type
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_null(kind)):
            raise RunFileError(f"{path}: column {name!r} holds {kind}, not numbers")
        columns[own] = floats(column)
    return RawTable(names, columns)


def encode_parquet(columns: Mapping[str, Array]) -> bytes:
    """Write equally long columns as Parquet; NaN becomes a missing value."""
    # Lazy: pyarrow takes 40 ms.
    import pyarrow.parquet as pq

    table = table_of(columns)
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    return sink.getvalue()


def _encode(run: RunTable) -> bytes:
    return encode_parquet(run.columns)


FORMAT = Format(
    name="parquet",
    title="Apache Parquet with this project's column names",
    suffix=".parquet",
    media_type="application/vnd.apache.parquet",
    recognise=_recognise,
    read=_read,
    encode=_encode,
)
