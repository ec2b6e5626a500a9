"""Rows on their way to the next commit."""

import numpy as np
import pytest

from bench_service.recorder.buffer import StreamBuffer
from bench_service.streams import Column, Layout, row_bytes

LAYOUT: Layout = (Column("time_s", "f8"), Column("flags", "u4"))


def body(seq0: int, n: int, time_s: float | None = None) -> bytes:
    """Struct of arrays, little endian, as a control process sends it."""
    index = np.arange(seq0, seq0 + n)
    time = index / 10.0 if time_s is None else np.full(n, time_s)
    return time.astype("<f8").tobytes() + index.astype("<u4").tobytes()


def buffer(next_seq: int = 0) -> StreamBuffer:
    return StreamBuffer("r1", "samples", LAYOUT, next_seq)


def test_rows_that_follow_each_other_are_one_stretch() -> None:
    kept = buffer()
    assert kept.add(0, 2, body(0, 2)) == 2 * row_bytes(LAYOUT) == 2 * 12
    kept.add(2, 3, body(2, 3))
    (rows,) = kept.take()
    assert (rows.run_id, rows.stream, rows.seq0) == ("r1", "samples", 0)
    assert rows.columns["flags"].tolist() == [0, 1, 2, 3, 4]
    assert kept.next_seq == 5


def test_a_hole_parts_them() -> None:
    kept = buffer()
    kept.add(0, 2, body(0, 2))
    kept.add(5, 1, body(5, 1))
    kept.add(6, 1, body(6, 1))
    assert [(rows.seq0, rows.columns["flags"].tolist()) for rows in kept.take()] == [(0, [0, 1]), (5, [5, 6])]


def test_what_is_stored_already_is_dropped() -> None:
    """After a new connection a control process sends again what was not acknowledged."""
    kept = buffer(next_seq=3)
    assert kept.add(0, 3, body(0, 3)) == 0
    assert kept.add(1, 4, body(1, 4)) == 2 * row_bytes(LAYOUT)
    (rows,) = kept.take()
    assert (rows.seq0, rows.columns["flags"].tolist()) == (3, [3, 4])


def test_what_was_taken_is_forgotten_but_not_taken_again() -> None:
    kept = buffer()
    kept.add(0, 2, body(0, 2))
    kept.take()
    assert kept.take() == []
    assert kept.add(0, 2, body(0, 2)) == 0


@pytest.mark.parametrize(
    ("seq0", "n", "sent"),
    [
        (-1, 1, body(0, 1)),
        (0, 2, body(0, 3)),
        (0, 2, b""),
        (0, 1, body(0, 1, float("nan"))),
        (0, 1, body(0, 1, float("inf"))),
    ],
)
def test_what_are_no_rows_is_refused_and_changes_nothing(seq0: int, n: int, sent: bytes) -> None:
    kept = buffer()
    with pytest.raises(ValueError):
        kept.add(seq0, n, sent)
    assert (kept.next_seq, kept.take()) == (0, [])
