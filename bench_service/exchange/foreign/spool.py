"""Columns of any length in bounded memory: appended in blocks, read in slices, kept in temporary files when large."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from types import TracebackType
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray[np.float64]]

_IN_MEMORY_BYTES = 4 << 20  # of one column; what is longer goes to a temporary file
SLICE = 1 << 18


class Spool:
    """Columns of float64 of one length."""

    def __init__(self) -> None:
        self._files: dict[str, BinaryIO] = {}
        self.n = 0
        self.lowest: dict[str, float] = {}
        self.highest: dict[str, float] = {}
        self.missing: dict[str, int] = {}

    def __enter__(self) -> Spool:
        """Hand itself out."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Remove the temporary files."""
        self.close()

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return list(self._files)

    def append(self, columns: Columns) -> None:
        """Append rows; every call brings the same columns."""
        if not self._files:
            for name in columns:
                self._add(name)
        for name, values in columns.items():
            self._write(name, values)
        self.n += len(next(iter(columns.values()))) if columns else 0

    def _add(self, name: str) -> None:
        spooled = tempfile.SpooledTemporaryFile(_IN_MEMORY_BYTES)  # noqa: SIM115  # closed by `close`
        self._files[name] = cast(BinaryIO, spooled)
        self.lowest[name], self.highest[name], self.missing[name] = np.inf, -np.inf, 0

    def _write(self, name: str, values: NDArray[np.float64]) -> None:
        self._files[name].seek(0, 2)
        self._files[name].write(np.ascontiguousarray(values, dtype=np.float64).tobytes())
        known = values[~np.isnan(values)]
        self.missing[name] += len(values) - len(known)
        if len(known):
            self.lowest[name] = min(self.lowest[name], float(known.min()))
            self.highest[name] = max(self.highest[name], float(known.max()))

    def column(self, name: str, start: int = 0, stop: int | None = None) -> NDArray[np.float64]:
        """(m,) rows `start` to `stop` of a column."""
        start, stop = max(start, 0), min(self.n if stop is None else stop, self.n)
        self._files[name].seek(8 * start)
        return np.frombuffer(self._files[name].read(8 * max(stop - start, 0)), dtype=np.float64)

    def rows(self, start: int, stop: int) -> Columns:
        """Rows `start` to `stop` of every column."""
        return {name: self.column(name, start, stop) for name in self._files}

    def slices(self, size: int = SLICE) -> Iterator[tuple[int, Columns]]:
        """First row and columns of one slice after the other."""
        for start in range(0, self.n, size):
            yield start, self.rows(start, start + size)

    def overwrite(self, name: str, start: int, values: NDArray[np.float64]) -> None:
        """Replace rows of a column from `start` on; its lowest and highest value are kept wide enough."""
        self._files[name].seek(8 * start)
        self._files[name].write(np.ascontiguousarray(values, dtype=np.float64).tobytes())
        known = values[~np.isnan(values)]
        if len(known):
            self.lowest[name] = min(self.lowest[name], float(known.min()))
            self.highest[name] = max(self.highest[name], float(known.max()))

    def negate(self, name: str) -> None:
        """Turn the sign of a column."""
        for start in range(0, self.n, SLICE):
            self.overwrite(name, start, -self.column(name, start, start + SLICE))
        self.lowest[name], self.highest[name] = -self.highest[name], -self.lowest[name]

    def derive(self, name: str, source: str, offset: float) -> None:
        """Add a column that is another one plus `offset`."""
        self._add(name)
        for start in range(0, self.n, SLICE):
            self._write(name, self.column(source, start, start + SLICE) + offset)

    def drop(self, name: str) -> None:
        """Forget a column."""
        self._files.pop(name).close()

    def close(self) -> None:
        """Remove the temporary files."""
        for file in self._files.values():
            file.close()
        self._files.clear()
