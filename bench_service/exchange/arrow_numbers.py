"""Numbers to and from Arrow without pandas.

pyarrow's own ways from and to Python and NumPy load pandas where it is installed, which takes 0.7 s of processor time
in each process that reads a log; its buffers do not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.format import Array

if TYPE_CHECKING:
    import pyarrow as pa


def floats(column: pa.ChunkedArray | pa.Array) -> NDArray[np.float64]:
    """(n,) numbers of a column of any numeric type; NaN where one is missing."""
    # Lazy: pyarrow takes 30 ms.
    import pyarrow as pa

    column = column.cast(pa.float64(), safe=False)
    chunks = column.chunks if isinstance(column, pa.ChunkedArray) else [column]
    return np.concatenate([np.zeros(0), *map(_chunk, chunks)])


def table_of(columns: Mapping[str, Array]) -> pa.Table:
    """Equally long columns as a table; NaN becomes a missing value."""
    # Lazy: pyarrow takes 30 ms.
    import pyarrow as pa

    return pa.Table.from_arrays([_column(values) for values in columns.values()], names=list(columns))


def _chunk(chunk: pa.Array) -> NDArray[np.float64]:
    there, values = chunk.buffers()
    part = slice(chunk.offset, chunk.offset + len(chunk))
    if values is None or chunk.null_count == len(chunk):
        return np.full(len(chunk), np.nan)
    found = np.frombuffer(values, np.float64)[part]
    if there is None or not chunk.null_count:
        return found
    known = np.unpackbits(np.frombuffer(there, np.uint8), bitorder="little")[part].astype(bool)
    return np.where(known, found, np.nan)


def _column(values: Array) -> pa.Array:
    import pyarrow as pa

    numbers = np.asarray(values)
    if numbers.dtype not in (np.float64, np.int64):
        return pa.array(values, from_pandas=True)
    missing = np.isnan(numbers)
    there = pa.py_buffer(np.packbits(~missing, bitorder="little")) if missing.any() else None
    kind = pa.float64() if numbers.dtype == np.float64 else pa.int64()
    return pa.Array.from_buffers(kind, len(numbers), [there, pa.py_buffer(np.ascontiguousarray(numbers))])
