import hashlib

import numpy as np
import pytest

from bench_service.streams import (
    SAMPLES,
    STREAMS,
    Column,
    Flag,
    content_hash,
    layout_from_json,
    layout_to_json,
    pack,
    row_bytes,
    unpack,
)

LAYOUT = STREAMS[SAMPLES]


def columns(n: int) -> dict[str, np.ndarray]:
    return {c.name: (np.arange(n) + i).astype(c.numpy) for i, c in enumerate(LAYOUT)}


def test_rows_survive_packing():
    sent = columns(5)
    body = pack(LAYOUT, sent)
    assert len(body) == 5 * row_bytes(LAYOUT)
    received = unpack(LAYOUT, 5, body)
    assert list(received) == [c.name for c in LAYOUT]
    for name, values in sent.items():
        np.testing.assert_array_equal(received[name], values, strict=True)


def test_packed_bytes_are_little_endian_struct_of_arrays():
    layout = (Column("time_s", "f8"), Column("flags", "u4"))
    body = pack(layout, {"time_s": np.array([1.0, 2.0], ">f8"), "flags": [1, 2]})
    assert body == np.array([1.0, 2.0], "<f8").tobytes() + bytes([1, 0, 0, 0, 2, 0, 0, 0])


@pytest.mark.parametrize("n", [4, 6, -1])
def test_a_body_of_another_length_is_refused(n):
    with pytest.raises(ValueError, match="bytes are not"):
        unpack(LAYOUT, n, pack(LAYOUT, columns(5)))


def test_columns_of_unequal_length_are_refused():
    with pytest.raises(ValueError, match="differ in shape"):
        pack(LAYOUT, columns(5) | {"flags": np.zeros(4)})


def test_layouts_go_through_json():
    assert layout_from_json(layout_to_json(LAYOUT)) == LAYOUT


@pytest.mark.parametrize("data", [[], [["a", "f8"], ["a", "f4"]], [["a", "O"]]])
def test_senseless_layouts_are_refused(data):
    with pytest.raises(ValueError, match="column"):
        layout_from_json(data)


def test_content_hash_covers_all_columns_but_lateness():
    sent = columns(3)
    expected = hashlib.sha256(b"".join(v.tobytes() for k, v in sent.items() if k != "lateness_s")).hexdigest()
    assert content_hash(sent) == expected
    assert content_hash(sent | {"lateness_s": np.full(3, 9, "f4")}) == expected
    for name in sent.keys() - {"lateness_s"}:
        assert content_hash(sent | {name: sent[name] + 1}) != expected
    assert content_hash({}) == hashlib.sha256().hexdigest()


def test_flags_keep_their_bits():
    assert [int(flag) for flag in Flag] == [1, 2, 4, 8, 16, 32, 64, 128, 256, 512]
