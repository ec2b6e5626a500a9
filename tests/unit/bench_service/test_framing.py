import json
import socket
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_service.framing import MAX_FRAME_BYTES, Decoder, FramingError, encode, recv_frame, send_frame

HEADERS = st.dictionaries(st.text(max_size=8), st.one_of(st.integers(-(2**40), 2**40), st.text(), st.none()))
FRAMES = st.lists(st.tuples(HEADERS, st.binary(max_size=200)), max_size=6)


@given(FRAMES, st.integers(1, 50))
def test_frames_survive_any_division_of_the_stream(frames, piece):
    stream = b"".join(encode(header, body) for header, body in frames)
    decoder = Decoder()
    received = []
    for start in range(0, len(stream), piece):
        received += decoder.feed(stream[start : start + piece])
    assert received == frames
    assert decoder.pending == 0


def test_layout_of_a_frame_is_the_documented_one():
    header = json.dumps({"op": "stop"}, separators=(",", ":")).encode()
    expected = struct.pack("<II", 4 + len(header) + 2, len(header)) + header + b"\x01\x02"
    assert encode({"op": "stop"}, b"\x01\x02") == expected


@pytest.mark.parametrize("value", [float("nan"), float("inf"), b"bytes"])
def test_a_header_that_is_no_json_is_refused(value):
    with pytest.raises(FramingError, match="'live' is not JSON"):
        encode({"op": "live", "voltage_V": value})


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (struct.pack("<I", MAX_FRAME_BYTES + 1), "outside 4 to"),
        (struct.pack("<I", 3), "outside 4 to"),
        (struct.pack("<II", 6, 3) + b"{}", "does not fit"),
        (struct.pack("<II", 6, 2) + b"[]", "JSON list"),
        (struct.pack("<II", 6, 2) + b"{x", "not JSON"),
        (struct.pack("<II", 6, 2) + b"\xff\xff", "not JSON"),
    ],
)
def test_bytes_that_are_no_frames_are_refused(data, message):
    with pytest.raises(FramingError, match=message):
        Decoder().feed(data)


def test_a_frame_over_the_limit_is_not_sent(monkeypatch):
    monkeypatch.setattr("bench_service.framing.MAX_FRAME_BYTES", 100)
    with pytest.raises(FramingError, match="over the limit of 100 bytes"):
        encode({}, bytes(100))


def test_blocking_ends_exchange_frames_and_see_the_end():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        send_frame(ours, {"op": "rows", "n": 2}, b"body")
        assert recv_frame(theirs) == ({"op": "rows", "n": 2}, b"body")
        ours.close()
        assert recv_frame(theirs) is None


def test_an_end_inside_a_frame_is_an_error():
    ours, theirs = socket.socketpair()
    with theirs:
        with ours:
            ours.sendall(encode({"op": "rows"}, b"body")[:-1])
        with pytest.raises(FramingError, match="1 bytes missing"):
            recv_frame(theirs)
