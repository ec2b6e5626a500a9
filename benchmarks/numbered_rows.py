"""Rows of samples that tell their own numbers, so that each can be looked for afterwards."""

from __future__ import annotations

import numpy as np

from bench_service.store.reading import StreamData
from bench_service.streams import SAMPLES, STREAMS, Columns

LAYOUT = STREAMS[SAMPLES]


def numbered(seq0: int, n: int) -> Columns:
    """Columns of `n` rows, each value of which is its row's number from `seq0` on."""
    return {column.name: np.arange(seq0, seq0 + n).astype(column.numpy) for column in LAYOUT}


def right_rows(data: StreamData) -> np.ndarray:
    """(n,) whether each row that was read is what had been sent."""
    right = np.ones(data.n, bool)
    for name, expected in numbered(0, data.n).items():
        right &= data.columns[name] == expected
    return right
