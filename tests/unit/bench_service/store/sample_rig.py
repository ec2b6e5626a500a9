"""Stored samples for tests, and what can happen to them."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np

from bench_service.store.sample_writer import Rows, SampleWriter
from bench_service.store.samples import FILE
from bench_service.streams import SAMPLES, STREAMS, Columns


def made(seq0: int, n: int) -> Columns:
    """Rows a second apart that anybody can make again."""
    seq = np.arange(seq0, seq0 + n)
    columns = {column.name: np.sin(seq).astype(column.numpy) for column in STREAMS[SAMPLES] if column.dtype[0] == "f"}
    columns |= {column.name: seq.astype(column.numpy) for column in STREAMS[SAMPLES] if column.dtype[0] != "f"}
    return columns | {"time_s": seq.astype(np.float64)}


def commit(writer: SampleWriter, run_id: str, seq0: int, n: int) -> None:
    """Store rows of a run."""
    writer.commit([Rows(run_id, SAMPLES, seq0, STREAMS[SAMPLES], made(seq0, n))])


def flip_bit(data_dir: Path, column: str, byte: int = 30, bit: int = 2) -> None:
    """Turn one bit round in a blob of every chunk."""
    with closing(sqlite3.connect(data_dir / FILE)) as link:
        for key, data in link.execute(f"SELECT id, {column} FROM chunk").fetchall():
            flipped = data[:byte] + bytes([data[byte] ^ 1 << bit]) + data[byte + 1 :]
            link.execute(f"UPDATE chunk SET {column} = ? WHERE id = ?", (flipped, key))
        link.commit()
