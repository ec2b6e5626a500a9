"""Battery Data Format as Parquet, written with its labels; read as any Parquet file is."""

from __future__ import annotations

import io

from bench_service.exchange.bdf import labelled
from bench_service.exchange.format import Format, RunTable


def _encode(run: RunTable) -> bytes:
    # Lazy: pyarrow takes 40 ms.
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({name: pa.array(values, from_pandas=True) for name, values in labelled(run).items()})
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    return sink.getvalue()


FORMAT = Format(
    name="bdf-parquet",
    title="Battery Data Format, Parquet",
    suffix=".bdf.parquet",
    media_type="application/vnd.apache.parquet",
    encode=_encode,
)
