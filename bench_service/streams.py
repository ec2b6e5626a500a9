"""Streams of samples that a control process sends to the recorder: columns, flags, packing, content hash.

A block of a stream is a struct of arrays: for each column in order, its values in little-endian order. The
sequence number of a row is not a column: it is the block's ``seq0`` plus the row's index.
"""

import enum
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray[Any]]
_DTYPES = ("f8", "f4", "i8", "i4", "u8", "u4", "u2", "u1")


class Flag(enum.IntFlag):
    """Quality of a sample; bits of the column ``flags``."""

    VOLTAGE_MISSING = 1
    CURRENT_MISSING = 2
    TEMPERATURE_MISSING = 4
    STALE = 8  # the device's sequence counter did not advance
    SETTLING = 16  # within the settling time after a change of the set-point
    DEVICE_CURRENT_LIMIT = 32  # the device holds the current at a limit of its own
    GAP_BEFORE = 64  # ticks were missed before this sample
    SUSPECT = 128  # a safety rule or the driver objected to this very sample, or its current does not follow
    PAUSED = 256  # somebody holds the run: output off, no set-point of the profile
    UNVERIFIED = 512  # the bench's hardware had no valid commissioning record when the run started


@dataclass(frozen=True, slots=True)
class Column:
    """Name (with unit) and numpy type code, e.g. ``Column("time_s", "f8")``; always little endian."""

    name: str
    dtype: str

    def __post_init__(self) -> None:
        """Refuse a type that is not in the list of plain numbers."""
        if self.dtype not in _DTYPES:
            raise ValueError(f"column {self.name!r} has type {self.dtype!r}; allowed are {', '.join(_DTYPES)}")

    @property
    def numpy(self) -> np.dtype[Any]:
        """The little-endian numpy type."""
        return np.dtype("<" + self.dtype)


Layout = tuple[Column, ...]

SAMPLES = "samples"
OBSERVER = "observer"
STEPS = "steps"
# Of a module: one column for each group of cells in series; which there are, a run says by itself.
CELLS = "cells"
_CELL_VOLTAGE = re.compile(r"v_cell([1-9][0-9]{0,2})_V")

STREAMS: Mapping[str, Layout] = MappingProxyType(
    {
        SAMPLES: (
            Column("time_s", "f8"),
            Column("current_A", "f8"),
            Column("voltage_V", "f8"),
            Column("temperature_degC", "f8"),
            Column("ambient_degC", "f8"),
            Column("setpoint_A", "f8"),
            Column("device_sequence", "u4"),
            Column("flags", "u4"),
            Column("lateness_s", "f4"),
            # Of a protocol, from 1, as they are played; 0 in a run that plays a profile.
            Column("step_count", "u4"),
            Column("cycle_count", "u4"),
        ),
        OBSERVER: (
            Column("time_s", "f8"),
            Column("soc", "f8"),
            Column("soc_std", "f8"),
            Column("model_voltage_V", "f8"),
            Column("innovation_V", "f8"),
        ),
        # One row for each step of a protocol that has ended: what it has moved, counted at every tick.
        STEPS: (
            Column("time_s", "f8"),
            Column("step_count", "u4"),
            Column("step_index", "u4"),
            Column("cycle_count", "u4"),
            Column("instruction", "u4"),
            Column("ended_by", "u1"),
            Column("duration_s", "f8"),
            Column("charged_Ah", "f8"),
            Column("discharged_Ah", "f8"),
            Column("charged_Wh", "f8"),
            Column("discharged_Wh", "f8"),
            Column("mean_voltage_V", "f8"),
            Column("end_voltage_V", "f8"),
            Column("end_current_A", "f8"),
            Column("end_temperature_degC", "f8"),
            Column("end_soc", "f8"),
        ),
    }
)


def cell_number(name: str) -> int | None:
    """Which group of a module's cells a column is the voltage of, counted from 1; None where it is none."""
    found = _CELL_VOLTAGE.fullmatch(name)
    return None if found is None else int(found[1])


def cells_layout(names: Sequence[str]) -> Layout:
    """Return the layout of the stream `CELLS` with these columns, such as ``v_cell1_V``."""
    return (Column("time_s", "f8"), *(Column(name, "f8") for name in names))


# Wall-clock lateness differs between two runs that are otherwise equal to the bit.
NOT_HASHED = frozenset({"lateness_s"})


def layout_to_json(layout: Layout) -> list[list[str]]:
    """Return a layout as it is written in the ``open`` message: ``[[name, dtype], ...]``."""
    return [[column.name, column.dtype] for column in layout]


def layout_from_json(data: Sequence[Sequence[str]]) -> Layout:
    """Return the layout of an ``open`` message.

    Raises
    ------
    ValueError
        A name occurs twice, or a type is not allowed.
    """
    layout = tuple(Column(str(name), str(dtype).removeprefix("<")) for name, dtype in data)
    if not layout or len({column.name for column in layout}) != len(layout):
        raise ValueError("a stream needs at least one column, each with a name of its own")
    return layout


def row_bytes(layout: Layout) -> int:
    """Return the size of one row in bytes."""
    return sum(column.numpy.itemsize for column in layout)


def pack(layout: Layout, columns: Mapping[str, Any]) -> bytes:
    """Return the body of a ``rows`` message.

    Parameters
    ----------
    layout : Layout
    columns : mapping of str to array_like, shape (n,)
        All columns of the layout, of equal length.

    Raises
    ------
    ValueError
        Columns differ in length.
    """
    arrays = [np.ascontiguousarray(columns[column.name], column.numpy) for column in layout]
    if len({array.shape for array in arrays}) != 1 or arrays[0].ndim != 1:
        raise ValueError(f"columns differ in shape: {[array.shape for array in arrays]}")
    return b"".join(array.tobytes() for array in arrays)


def unpack(layout: Layout, n: int, body: bytes) -> Columns:
    """Return the columns in the body of a ``rows`` message, as read-only arrays of shape (n,).

    Raises
    ------
    ValueError
        The body's length is not that of `n` rows.
    """
    if n < 0 or len(body) != n * row_bytes(layout):
        raise ValueError(f"{len(body)} bytes are not {n} rows of {row_bytes(layout)} bytes")
    columns: Columns = {}
    offset = 0
    for column in layout:
        columns[column.name] = np.frombuffer(body, column.numpy, n, offset)
        offset += n * column.numpy.itemsize
    return columns


def content_hash(columns: Mapping[str, NDArray[Any]], layout: Layout = STREAMS[SAMPLES]) -> str:
    """Return the SHA-256 of a run's samples in hexadecimal: the columns' bytes in the layout's order.

    Columns in `NOT_HASHED` are left out, so that two equal lock-step runs have equal hashes. A run without rows
    has the hash of no bytes.
    """
    digest = hashlib.sha256()
    for column in layout:
        if column.name not in NOT_HASHED and column.name in columns:
            digest.update(np.ascontiguousarray(columns[column.name], column.numpy).data)
    return digest.hexdigest()
