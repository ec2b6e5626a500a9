"""The simulators' own codec against the map's sample frames and by hand."""

import math
from dataclasses import replace

import pytest

from drivers.register_map import Register, load_map
from simulators.registers import RegisterCodec

GENERIC = load_map("generic")
CONSTANTS = {"i_nom": 30.0, "v_nom": 6.0}


def codec(name: str, **changes: object) -> RegisterCodec:
    register: Register = replace(GENERIC.registers[name], **changes)  # pyright: ignore[reportArgumentType]
    return RegisterCodec(register, CONSTANTS)


def registers_in(data: bytes, first: int) -> dict[str, bytes]:
    found = {}
    for name, register in GENERIC.registers.items():
        start = 2 * (register.address - first)
        if register.space == "holding" and 0 <= start < len(data):
            found[name] = data[start : start + 2 * register.words]
    return found


def test_sample_frames_of_the_map_are_encoded_and_decoded() -> None:
    seen = set()
    for frame in GENERIC.frames:
        first = int.from_bytes(frame.request[1:3], "big")
        data = frame.reply[2:] if frame.request[0] == 3 else frame.request[6:]
        for name, raw in registers_in(data, first).items():
            value = math.nan if name in frame.missing else float(frame.values[name])
            assert codec(name).encode(value) == raw, f"{name} in {frame.meaning}"
            seen.add(name)
            if frame.request[0] == 16:
                assert codec(name).decode(raw) == pytest.approx(value, rel=1e-7)
    assert {"actual_current", "ambient_temperature", "lock_step"} <= seen


def test_scale_and_saturation() -> None:
    assert codec("temperature").encode(-12.34) == (-1234 & 0xFFFF).to_bytes(2, "big")
    assert codec("temperature").encode(1000.0) == bytes.fromhex("7fff")
    assert codec("watchdog").decode((1500).to_bytes(2, "big")) == pytest.approx(1.5)


def test_what_an_integer_cannot_say_reads_its_largest_value() -> None:
    register = replace(GENERIC.registers["temperature"], invalid=())
    assert RegisterCodec(register, {}).encode(math.nan) == bytes.fromhex("7fff")
    assert RegisterCodec(register, {}).encode(-math.inf) == bytes.fromhex("8000")
    assert codec("temperature").encode(math.nan) != bytes.fromhex("7fff")


def test_word_order() -> None:
    little = codec("set_current", word_order="little")
    assert little.encode(2.5) == bytes.fromhex("0000 4020")
    assert little.decode(bytes.fromhex("0000 4020")) == 2.5


@pytest.mark.parametrize(
    ("name", "raw"),
    [
        ("set_current", "7fc00000"),  # NaN
        ("set_current", "7f800000"),  # infinity
        ("set_current", "41f10000"),  # 30.125 A
        ("watchdog", "0000"),
        ("lock_step_period", "00000001"),
    ],
)
def test_values_that_no_client_may_write(name: str, raw: str) -> None:
    with pytest.raises(ValueError, match=name):
        codec(name).decode(bytes.fromhex(raw))


def test_invalid_pattern_and_raw_max_are_refused() -> None:
    with pytest.raises(ValueError, match="means missing"):
        codec("temperature").decode(bytes.fromhex("8000"))
    with pytest.raises(ValueError, match="above 100"):
        codec("heartbeat", raw_max=100).decode((101).to_bytes(2, "big"))


def test_text_is_padded_and_cut() -> None:
    text = codec("heartbeat", type="string", words=3)
    assert text.encode("PSB") == b"PSB\0\0\0"
    assert text.encode("PSB 9000") == b"PSB 90"
