"""Battery Data Format CSV with the labels that the package batterydf 0.1.0 knows."""

from __future__ import annotations

from bench_service.exchange.bdf import labelled_0_1
from bench_service.exchange.delimited import encode_csv
from bench_service.exchange.format import Format, RunTable


def _encode(run: RunTable) -> bytes:
    return encode_csv(labelled_0_1(run))


FORMAT = Format(
    name="bdf-0.1.0",
    title="Battery Data Format with the labels of batterydf 0.1.0, CSV",
    suffix=".bdf.csv",
    media_type="text/csv",
    encode=_encode,
)
