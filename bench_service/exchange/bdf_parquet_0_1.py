"""Battery Data Format as Parquet, with the labels that the package batterydf 0.1.0 knows."""

from __future__ import annotations

from bench_service.exchange.bdf import labelled_0_1
from bench_service.exchange.format import Format, RunTable
from bench_service.exchange.parquet import encode_parquet


def _encode(run: RunTable) -> bytes:
    return encode_parquet(labelled_0_1(run))


FORMAT = Format(
    name="bdf-parquet-0.1.0",
    title="Battery Data Format with the labels of batterydf 0.1.0, Parquet",
    suffix=".bdf.parquet",
    media_type="application/vnd.apache.parquet",
    encode=_encode,
)
