from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bench_service.store.blocks import CODEC, Block, BlockError, decode, encode
from bench_service.streams import SAMPLES, STREAMS, Column

TYPES = ("f8", "f4", "i8", "u4", "u2", "u1")


@st.composite
def tables(draw):
    n = draw(st.integers(0, 60))
    layout = tuple(Column(f"c{i}", t) for i, t in enumerate(draw(st.lists(st.sampled_from(TYPES), min_size=1))))
    return layout, {c.name: draw(hnp.arrays(c.numpy, n)) for c in layout}


@given(tables(), st.integers(0, 2**50))
def test_every_value_survives_to_the_bit(table, seq0):
    layout, columns = table
    block = encode(seq0, layout, columns)
    read_layout, read = decode(block)
    assert read_layout == layout
    assert (block.seq0, block.codec) == (seq0, CODEC)
    for column in layout:
        assert read[column.name].dtype == column.numpy
        assert read[column.name].tobytes() == columns[column.name].tobytes()


def example() -> Block:
    layout = STREAMS[SAMPLES]
    rng = np.random.default_rng(3)
    return encode(
        200,
        layout,
        {
            c.name: rng.normal(size=100).astype(c.numpy) if c.dtype[0] == "f" else np.arange(100, dtype=c.numpy)
            for c in layout
        },
    )


@given(st.data())
def test_a_flipped_bit_is_noticed(data):
    block = example()
    place = data.draw(st.integers(0, len(block.data) - 1))
    damaged = bytearray(block.data)
    damaged[place] ^= 1 << data.draw(st.integers(0, 7))
    with pytest.raises(BlockError, match="checksum"):
        decode(replace(block, data=bytes(damaged)))


@pytest.mark.parametrize("change", [{"seq0": 201}, {"n": 99}, {"crc": 0}, {"data": b""}])
def test_a_changed_field_is_noticed(change):
    with pytest.raises(BlockError, match="checksum"):
        decode(replace(example(), **change))


def test_an_unknown_codec_is_named():
    with pytest.raises(BlockError, match="'shuffle-lzma/9'"):
        decode(replace(example(), codec="shuffle-lzma/9"))


def test_columns_of_unequal_length_are_refused():
    layout = (Column("a", "f8"), Column("b", "f8"))
    with pytest.raises(ValueError, match="differ in shape"):
        encode(0, layout, {"a": np.zeros(3), "b": np.zeros(2)})


def test_a_slowly_changing_signal_shrinks():
    time_s = np.arange(36_000) * 0.1
    block = encode(0, (Column("time_s", "f8"),), {"time_s": time_s})
    assert len(block.data) < time_s.nbytes / 2
