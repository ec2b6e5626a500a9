"""CSV, gzipped or not: read by Battery Data Format label or own name, written with own names."""

from __future__ import annotations

from pathlib import Path

from bench_service.exchange.columns import choose_columns
from bench_service.exchange.delimited import encode_csv, is_text_table, read_columns
from bench_service.exchange.errors import RunFileError
from bench_service.exchange.format import Format, RawTable, RunTable


def _read(path: Path) -> RawTable:
    names, columns = read_columns(path, lambda found: choose_columns(str(path), found), RunFileError)
    return RawTable(names, columns)


def _encode(run: RunTable) -> bytes:
    return encode_csv(run.columns)


FORMAT = Format(
    name="csv",
    title="CSV with this project's column names",
    suffix=".csv",
    media_type="text/csv",
    recognise=is_text_table,
    read=_read,
    encode=_encode,
)
