"""Rows of a stream put together again, with what is missing."""

import numpy as np
import pytest

from bench_service.store.reading import Assembler, Gap, StreamData
from bench_service.streams import Column, Columns, Layout

LAYOUT: Layout = (Column("time_s", "f8"), Column("flags", "u4"))


def rows(seq0: int, n: int) -> Columns:
    """Time and flags that tell which rows they are."""
    index = np.arange(seq0, seq0 + n)
    return {"time_s": index / 10.0, "flags": index.astype("<u4")}


def put_together(*blocks: tuple[int, int], capacity: int = 100, first_seq: int | None = 0) -> StreamData:
    assembler = Assembler(capacity, first_seq)
    for seq0, n in blocks:
        assembler.add(seq0, n, LAYOUT, rows(seq0, n))
    return assembler.result()


def test_blocks_one_after_the_other_are_one_stream() -> None:
    data = put_together((0, 3), (3, 2))
    assert data.seq.tolist() == data.columns["flags"].tolist() == [0, 1, 2, 3, 4]
    assert (data.n, data.gaps, data.damaged, data.layout) == (5, (), False, LAYOUT)


def test_rows_that_come_twice_are_taken_once() -> None:
    """A resent block overlaps with the one before; a sealed one holds earlier ones whole."""
    data = put_together((0, 4), (2, 4), (1, 3))
    assert data.seq.tolist() == data.columns["flags"].tolist() == [0, 1, 2, 3, 4, 5]
    assert data.gaps == ()


def test_holes_before_and_between_are_told() -> None:
    data = put_together((2, 2), (7, 1))
    assert data.seq.tolist() == [2, 3, 7]
    assert data.gaps == (Gap(0, 2, "missing"), Gap(4, 3, "missing"))
    assert not data.damaged


def test_where_a_stream_begins_may_not_be_known() -> None:
    assert put_together((5, 2), first_seq=None).gaps == ()


def test_a_damaged_block_is_a_hole_with_its_reason() -> None:
    assembler = Assembler(100, 0)
    assembler.add(0, 2, LAYOUT, rows(0, 2))
    assembler.add_damaged(2, 3, "checksum")
    assembler.add(5, 1, LAYOUT, rows(5, 1))
    data = assembler.result()
    assert data.seq.tolist() == [0, 1, 5]
    assert data.gaps == (Gap(2, 3, "checksum"),) and data.damaged


def test_a_damaged_block_whose_rows_are_there_already_is_no_hole() -> None:
    assembler = Assembler(100, 0)
    assembler.add(0, 4, LAYOUT, rows(0, 4))
    assembler.add_damaged(1, 2, "checksum")
    assembler.add_damaged(3, 3, "checksum")
    assert assembler.result().gaps == (Gap(4, 2, "checksum"),)


def test_a_block_with_other_columns_is_not_mixed_in() -> None:
    assembler = Assembler(100, 0)
    assembler.add(0, 2, LAYOUT, rows(0, 2))
    assembler.add(2, 2, LAYOUT[:1], {"time_s": np.zeros(2)})
    data = assembler.result()
    assert data.n == 2 and data.damaged
    assert data.gaps == (Gap(2, 2, "rows 2 to 3 have other columns than those before"),)


@pytest.mark.parametrize(
    ("from_s", "to_s", "seq"),
    [
        (None, None, [0, 1, 2, 3, 4]),
        (0.2, None, [2, 3, 4]),
        (None, 0.2, [0, 1, 2]),
        (0.1, 0.3, [1, 2, 3]),
        (0.15, 0.15, []),
    ],
)
def test_rows_between_two_times_both_ends_included(from_s: float | None, to_s: float | None, seq: list[int]) -> None:
    found = put_together((0, 5)).between(from_s, to_s)
    assert found.seq.tolist() == found.columns["flags"].tolist() == seq


def test_a_stream_without_rows_stays_one() -> None:
    empty = StreamData.empty()
    assert (empty.n, empty.damaged, empty.between(0.0, 1.0)) == (0, False, empty)
