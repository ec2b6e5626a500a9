"""What is read back of a run's stream: rows in order, and where rows are missing."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_service.streams import Columns, Layout


@dataclass(frozen=True, slots=True)
class Gap:
    """Rows that are not there: never recorded, or stored and damaged.

    Attributes
    ----------
    seq0, n : int
        First missing sequence number, and how many.
    reason : str
        ``"missing"``, or what is wrong with which chunk.
    """

    seq0: int
    n: int
    reason: str


@dataclass(frozen=True, slots=True)
class StreamData:
    """Rows of one stream of one run, in order of their sequence numbers.

    Attributes
    ----------
    layout : Layout
        Columns in their order; empty when there are no rows.
    columns : dict of str to ndarray, shape (n,)
    seq : ndarray of int64, shape (n,)
    gaps : tuple of Gap
        Holes before, between and, where a damaged chunk says so, after the rows.
    """

    layout: Layout
    columns: Columns
    seq: NDArray[np.int64]
    gaps: tuple[Gap, ...]

    @classmethod
    def empty(cls) -> "StreamData":
        """Return a stream without rows."""
        return cls((), {}, np.empty(0, np.int64), ())

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.seq)

    @property
    def damaged(self) -> bool:
        """Whether a stored chunk could not be read."""
        return any(gap.reason != "missing" for gap in self.gaps)

    def between(self, from_s: float | None, to_s: float | None) -> "StreamData":
        """Return the rows with ``from_s <= time_s <= to_s``; None leaves an end open."""
        if self.n == 0 or (from_s is None and to_s is None):
            return self
        time_s = self.columns["time_s"]
        keep: NDArray[Any] = np.ones(self.n, bool)
        if from_s is not None:
            keep &= time_s >= from_s
        if to_s is not None:
            keep &= time_s <= to_s
        columns = {name: values[keep] for name, values in self.columns.items()}
        return StreamData(self.layout, columns, self.seq[keep], self.gaps)


class Assembler:
    """Puts decoded blocks of a stream together, in order of `seq0`; rows that come twice are taken once."""

    def __init__(self, capacity: int, first_seq: int | None) -> None:
        """Make room for `capacity` rows; rows before `first_seq` (None: not known) are not called missing."""
        self._capacity = capacity
        self._layout: Layout = ()
        self._columns: Columns = {}
        self._seq = np.empty(capacity, np.int64)
        self._n = 0
        self._next = first_seq
        self._gaps: list[Gap] = []

    def add(self, seq0: int, n: int, layout: Layout, columns: Columns) -> None:
        """Append one block; its layout must be that of the blocks before it."""
        if self._layout and layout != self._layout:
            self.add_damaged(seq0, n, f"rows {seq0} to {seq0 + n - 1} have other columns than those before")
            return
        skip = self._advance(seq0)
        if skip >= n:
            return
        if not self._layout:
            self._layout = layout
            self._columns = {column.name: np.empty(self._capacity, column.numpy) for column in layout}
        rows = slice(self._n, self._n + n - skip)
        for name, values in self._columns.items():
            values[rows] = columns[name][skip:]
        self._seq[rows] = np.arange(seq0 + skip, seq0 + n)
        self._n = rows.stop
        self._next = seq0 + n

    def add_damaged(self, seq0: int, n: int, reason: str) -> None:
        """Note a block that cannot be read."""
        skip = self._advance(seq0)
        if skip < n:
            self._gaps.append(Gap(seq0 + skip, n - skip, reason))
            self._next = seq0 + n

    def result(self) -> StreamData:
        """Return what was put together."""
        columns = {name: values[: self._n] for name, values in self._columns.items()}
        return StreamData(self._layout, columns, self._seq[: self._n], tuple(self._gaps))

    def _advance(self, seq0: int) -> int:
        """Note a hole before `seq0`; return how many rows from `seq0` on are there already."""
        if self._next is None:
            self._next = seq0
        if seq0 > self._next:
            self._gaps.append(Gap(self._next, seq0 - self._next, "missing"))
        return max(self._next - seq0, 0)
