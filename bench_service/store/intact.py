"""Reads a stream of which every chunk is there and sound: in place, on two cores. The usual case, and the fast one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Row

from bench_service.store.blocks import Block, BlockError, decode, decode_into
from bench_service.store.reading import StreamData
from bench_service.streams import Columns, Layout

# Unpacking and checking leave the interpreter to others; few chunks are held at a time.
_THREADS = 2
_AHEAD = 8


def block_of(row: Row[Any]) -> Block:
    """Return the block in a row of the table `chunk`."""
    return Block(row.seq0, row.n, row.codec, row.crc, row.data)


def check_times(row: Row[Any], columns: Mapping[str, NDArray[Any]]) -> None:
    """Times stand beside a chunk, outside its checksum; by them it is found."""
    if time_range(columns) != (row.t0, row.t1):
        raise BlockError(f"it is listed as {row.t0:g} to {row.t1:g} s, its rows are of other times")


def time_range(columns: Mapping[str, NDArray[Any]]) -> tuple[float, float]:
    """Return the earliest and the latest time of rows."""
    time_s = columns["time_s"]
    return float(np.min(time_s)), float(np.max(time_s))


def read_intact(rows: Iterable[Row[Any]], capacity: int, first_seq: int | None) -> StreamData | None:
    """Return a stream, or None where a chunk is missing, damaged, or comes twice: who reads must then look closely.

    Parameters
    ----------
    rows : iterable
        Of the table `chunk`, in order of ``seq0``.
    capacity : int
        Rows of samples in all.
    first_seq : int or None
        Where the stream begins; None: not known.
    """
    layout: Layout = ()
    columns: Columns = {}
    began, at, waiting = first_seq, 0, []
    with ThreadPoolExecutor(_THREADS, thread_name_prefix="decode") as pool:
        for row in rows:
            began = row.seq0 if began is None else began
            if row.seq0 != began + at or at + row.n > capacity:
                return None
            if not layout:
                if (layout := _layout_of(row)) == ():
                    return None
                columns = {column.name: np.empty(capacity, column.numpy) for column in layout}
            part = {name: values[at : at + row.n] for name, values in columns.items()}
            waiting.append(pool.submit(_place, row, layout, part))
            at += row.n
            if len(waiting) > _AHEAD and not waiting.pop(0).result():
                return None
        if not all(each.result() for each in waiting):
            return None
    found = {name: values[:at] for name, values in columns.items()}
    return StreamData(layout, found, np.arange(began or 0, (began or 0) + at), ())


def _layout_of(row: Row[Any]) -> Layout:
    try:
        return decode(block_of(row))[0]
    except BlockError:
        return ()


def _place(row: Row[Any], layout: Layout, columns: Columns) -> bool:
    try:
        decode_into(block_of(row), layout, columns)
        check_times(row, columns)
    except BlockError:
        return False
    return True
