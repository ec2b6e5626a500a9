"""Battery Data Format as Parquet, written with its labels; read as any Parquet file is."""

from __future__ import annotations

from bench_service.exchange.bdf import labelled
from bench_service.exchange.format import Format, RunTable
from bench_service.exchange.parquet import encode_parquet


def _encode(run: RunTable) -> bytes:
    return encode_parquet(labelled(run))


FORMAT = Format(
    name="bdf-parquet",
    title="Battery Data Format 1.3.0, Parquet",
    suffix=".bdf.parquet",
    media_type="application/vnd.apache.parquet",
    encode=_encode,
)
