"""Reading in place gives what the chunks hold, and steps back where one is not as it should be."""

from dataclasses import asdict
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench_service.store.blocks import encode
from bench_service.store.intact import read_intact
from bench_service.streams import Column

LAYOUT = (Column("time_s", "f8"), Column("lateness_s", "f4"), Column("flags", "u4"))
N = 7


def rows(seqs: range = range(0, 70, N)) -> list[Any]:
    found = []
    for seq0 in seqs:
        time_s = np.arange(seq0, seq0 + N) * 0.5
        block = encode(seq0, LAYOUT, {"time_s": time_s, "lateness_s": -time_s, "flags": np.arange(seq0, seq0 + N)})
        found.append(SimpleNamespace(**asdict(block), t0=time_s[0], t1=time_s[-1]))
    return found


def test_rows_come_in_their_order() -> None:
    data = read_intact(rows(), 70, 0)
    assert data is not None and data.layout == LAYOUT and data.gaps == ()
    np.testing.assert_array_equal(data.columns["time_s"], np.arange(70) * 0.5)
    np.testing.assert_array_equal(data.columns["flags"], data.seq)
    part = read_intact(rows(range(14, 28, N)), 14, None)
    assert part is not None and list(part.seq) == list(range(14, 28))
    nothing = read_intact([], 0, 0)
    assert nothing is not None and nothing.n == 0


def other_columns(row: Any) -> None:
    block = encode(row.seq0, LAYOUT[:1], {"time_s": np.arange(row.seq0, row.seq0 + N) * 0.5})
    row.data, row.crc = block.data, block.crc


@pytest.mark.parametrize(
    "spoil",
    [
        lambda row: setattr(row, "crc", row.crc ^ 1),
        lambda row: setattr(row, "t1", row.t1 + 1.0),
        lambda row: setattr(row, "seq0", row.seq0 + 1),
        lambda row: setattr(row, "codec", "other/1"),
        other_columns,
    ],
    ids=["checksum", "times", "hole", "codec", "columns"],
)
@pytest.mark.parametrize("at", [0, 4, 9])
def test_one_that_is_not_as_it_should_be_is_left_to_a_closer_look(spoil: Any, at: int) -> None:
    chunks = rows()
    spoil(chunks[at])
    assert read_intact(chunks, 70, 0) is None
