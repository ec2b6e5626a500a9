"""Rows that have come in and are not committed yet. Pure."""

import numpy as np

from bench_service.store.sample_writer import Rows
from bench_service.streams import Columns, Layout, row_bytes, unpack


class StreamBuffer:
    """Rows of one stream of one run, gathered for the next commit.

    Parameters
    ----------
    run_id, stream : str
    layout : Layout
    next_seq : int
        First sequence number that is not stored yet; rows before it are dropped as repetitions.
    """

    def __init__(self, run_id: str, stream: str, layout: Layout, next_seq: int) -> None:
        self.run_id = run_id
        self.stream = stream
        self.layout = layout
        self.next_seq = next_seq
        self._parts: list[tuple[int, int, Columns]] = []

    def add(self, seq0: int, n: int, body: bytes) -> int:
        """Take the body of a ``rows`` message; return the number of bytes kept.

        Raises
        ------
        ValueError
            The body is not `n` rows, `seq0` is negative, or a time is not finite.
        """
        columns = unpack(self.layout, n, body)
        if seq0 < 0:
            raise ValueError(f"sequence number {seq0} is negative")
        if not np.isfinite(columns["time_s"]).all():
            raise ValueError(f"time_s of rows {seq0} to {seq0 + n - 1} is not finite")
        skip = max(self.next_seq - seq0, 0)
        if skip >= n:
            return 0
        self._parts.append((seq0 + skip, n - skip, {name: part[skip:] for name, part in columns.items()}))
        self.next_seq = seq0 + n
        return (n - skip) * row_bytes(self.layout)

    def take(self) -> list[Rows]:
        """Return the gathered rows, one `Rows` for each stretch without a hole, and forget them."""
        stretches: list[list[tuple[int, int, Columns]]] = []
        for part in self._parts:
            previous = stretches[-1][-1] if stretches else None
            if previous is not None and previous[0] + previous[1] == part[0]:
                stretches[-1].append(part)
            else:
                stretches.append([part])
        self._parts = []
        return [self._rows(stretch) for stretch in stretches]

    def _rows(self, stretch: list[tuple[int, int, Columns]]) -> Rows:
        names = [column.name for column in self.layout]
        columns = {name: np.concatenate([part[2][name] for part in stretch]) for name in names}
        return Rows(self.run_id, self.stream, stretch[0][0], self.layout, columns)
