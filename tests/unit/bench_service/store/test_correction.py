"""A wrong bit is found by its checksum alone."""

import zlib
from dataclasses import replace

import numpy as np
import pytest

from bench_service.store.blocks import Block, decode, encode
from bench_service.store.correction import corrected
from bench_service.streams import SAMPLES, STREAMS
from tests.unit.bench_service.store.sample_rig import made

SOUND = encode(4000, STREAMS[SAMPLES], made(4000, 500))


def with_bits(block: Block, *places: int) -> Block:
    data = bytearray(block.data)
    for place in places:
        data[place // 8] ^= 1 << place % 8
    return replace(block, data=bytes(data))


def test_any_bit_of_the_data_is_turned_back() -> None:
    n_bits = 8 * len(SOUND.data)
    rng = np.random.default_rng(7)
    for place in {0, 1, n_bits - 1, *rng.integers(0, n_bits, 12).tolist()}:
        assert corrected(with_bits(SOUND, place)) == SOUND


@pytest.mark.parametrize("bit", [0, 5, 30])
def test_so_is_one_of_place_and_checksum(bit: int) -> None:
    assert corrected(replace(SOUND, seq0=SOUND.seq0 ^ 1 << bit)) == SOUND
    assert corrected(replace(SOUND, n=SOUND.n ^ 1 << bit)) == SOUND
    assert corrected(replace(SOUND, crc=SOUND.crc ^ 1 << bit)) == SOUND


def test_more_than_one_is_left_alone() -> None:
    rng = np.random.default_rng(8)
    for _ in range(5):
        found = corrected(with_bits(SOUND, *rng.choice(8 * len(SOUND.data), 2, replace=False).tolist()))
        assert found is None
    assert corrected(replace(SOUND, data=SOUND.data[:-10])) is None
    assert corrected(replace(SOUND, data=b"")) is None


def test_a_block_whose_checksum_is_right_is_not_touched() -> None:
    assert corrected(SOUND) is None
    nonsense = b"nonsense"
    place = SOUND.seq0.to_bytes(8, "little") + SOUND.n.to_bytes(8, "little")
    assert corrected(replace(SOUND, data=nonsense, crc=zlib.crc32(place + nonsense))) is None
    assert decode(SOUND)[1]["time_s"][0] == 4000.0
