import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.codec import BlockDecoder, bind
from drivers.device_map import TYPE_WORDS, Register
from drivers.errors import CyclerProtocolError, SetPointRefusedError
from drivers.expression import parse_expression


def register(kind="u16", *, words=None, scale=None, limits=None, order="big", unit="A", **more):
    return Register(
        name="probe",
        address=0,
        type=kind,
        words=words or TYPE_WORDS[kind],
        space="holding",
        access="rw",
        word_order=order,
        unit=unit,
        scale=parse_expression(scale) if scale else None,
        range=tuple(parse_expression(part) for part in limits) if limits else None,
        **more,
    )


@pytest.mark.parametrize(
    ("kind", "order", "value", "words"),
    [
        # IEEE 754 and two's complement by hand: 3.7 = 0x406CCCCD, -12.5 = 0xC1480000, 2.5 = 0x40200000
        ("f32", "big", -12.5, (0xC148, 0x0000)),
        ("f32", "little", 2.5, (0x0000, 0x4020)),
        ("f64", "big", -2.0, (0xC000, 0, 0, 0)),
        ("f64", "little", 1.0, (0, 0, 0, 0x3FF0)),
        ("u32", "big", 65538, (1, 2)),
        ("u32", "little", 65538, (2, 1)),
        ("i32", "big", -2, (0xFFFF, 0xFFFE)),
        ("i16", "big", -2, (0xFFFE,)),
        ("u16", "little", 0x1234, (0x1234,)),
    ],
)
def test_known_words(kind, order, value, words):
    codec = bind(register(kind, order=order), {})
    assert codec.encode(value) == words
    assert codec.decode(words) == value


def test_a_decimal_scale_reads_the_decimal_number():
    codec = bind(register("i16", scale="0.01"), {})
    assert codec.decode([2531]) == 25.31
    assert codec.encode(-25.31) == ((1 << 16) - 2531,)


def test_percent_scaling_of_a_nominal_value():
    codec = bind(register("u16", scale="i_nom/52428", limits=("0", "i_nom*1.02")), {"i_nom": 40.0})
    assert codec.encode(40.0) == (0xCCCC,)
    assert codec.decode([0x6666]) == pytest.approx(20.0)


def test_a_device_with_the_other_sign_is_turned_here():
    codec = bind(register("f32", limits=("-5", "10")), {}, -1.0)
    assert codec.encode(10.0) == tuple(struct.unpack(">2H", struct.pack(">f", -10.0)))
    assert codec.decode(codec.encode(10.0)) == 10.0
    assert codec.encode(0.0) == (0, 0)
    with pytest.raises(SetPointRefusedError):
        codec.encode(-6.0)


def test_text():
    codec = bind(register("string", words=4, unit=""), {})
    assert codec.decode(codec.encode("PSB 90")) == "PSB 90"
    assert codec.encode("AB") == (0x4142, 0, 0, 0)
    for bad in ("too long for it", "Ω", 3.0):
        with pytest.raises(SetPointRefusedError):
            codec.encode(bad)
    with pytest.raises(CyclerProtocolError):
        codec.decode([0xFFFF] * 4)


@pytest.mark.parametrize(
    ("kind", "invalid", "words"),
    [
        ("i16", (0x8000,), [0x8000]),
        ("u16", (0xFFFF, 0xFFFE), [0xFFFE]),
        ("u32", (0xFFFFFFFF,), [0xFFFF, 0xFFFF]),
        ("f32", (0x7DCCCCCD,), [0x7DCC, 0xCCCD]),
        ("f32", (), [0x7FC0, 0]),
        ("f32", (), [0xFF80, 0]),
        ("f64", (), [0x7FF0, 0, 0, 0]),
    ],
)
def test_missing_values_are_nan(kind, invalid, words):
    value = bind(register(kind, invalid=invalid), {}).decode(words)
    assert isinstance(value, float) and math.isnan(value)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, "3"])
@pytest.mark.parametrize("kind", ["u16", "i32", "f32", "f64"])
def test_only_finite_numbers_are_encoded(kind, value):
    with pytest.raises(SetPointRefusedError, match=r"'probe'.*not a finite number.*not sent"):
        bind(register(kind), {}).encode(value)


@pytest.mark.parametrize(
    ("made", "value", "says"),
    [
        (register("f32", limits=("-i", "i")), 10.5, r"10\.5 A is outside -10 \.\. 10 A"),
        (register("u16", scale="0.01"), 656.0, r"656 A needs raw 65600, beyond 0 \.\. 65535"),
        (register("u16"), -1.0, r"-1 A needs raw -1"),
        (register("u16", raw_max=0xD0E5), 0xD0E6, r"beyond 0 \.\. 53477"),
        (register("i16", invalid=(0x8000,)), -32768, "reads as 'missing'"),
        (register("f32"), 1e39, "beyond"),
        (register("f32"), 3.4028236e38, "beyond"),
    ],
)
def test_a_refusal_names_register_value_unit_and_limit(made, value, says):
    with pytest.raises(SetPointRefusedError, match=f"'probe': .*{says}"):
        bind(made, {"i": 10.0}).encode(value)


def test_wrong_number_of_registers():
    with pytest.raises(CyclerProtocolError, match="needs 2 words, not 1"):
        bind(register("f32"), {}).decode([1])


@pytest.mark.parametrize(
    ("scale", "limits", "constants"),
    [("i_nom/100", None, {"i_nom": 0.0}), ("1/i_nom", None, {"i_nom": 0.0}), (None, ("i_nom", "1"), {"i_nom": 2.0})],
)
def test_constants_that_make_a_register_unusable(scale, limits, constants):
    with pytest.raises(CyclerProtocolError, match="'probe'"):
        bind(register("u16", scale=scale, limits=limits), constants)


orders = st.sampled_from(["big", "little"])


@given(st.sampled_from(["u16", "i16", "u32", "i32"]), orders, st.data())
def test_whole_numbers_survive(kind, order, data):
    bits = 16 * TYPE_WORDS[kind]
    low, high = (0, 2**bits - 1) if kind[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    value = data.draw(st.integers(low, high))
    codec = bind(register(kind, order=order), {})
    words = codec.encode(value)
    assert codec.decode(words) == value
    assert codec.encode(codec.decode(words)) == words


@given(orders, st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_single_precision_survives(order, value):
    codec = bind(register("f32", order=order), {})
    assert codec.decode(codec.encode(value)) == value


@given(orders, st.floats(allow_nan=False, allow_infinity=False))
def test_double_precision_survives(order, value):
    codec = bind(register("f64", order=order), {})
    assert codec.decode(codec.encode(value)) == value


@given(st.sampled_from(["0.01", "0.001", "1e-6", "i_nom/52428", "-0.1", "3"]), st.integers(-32768, 32767))
def test_scaled_raw_values_survive(scale, raw):
    codec = bind(register("i16", scale=scale), {"i_nom": 37.5})
    words = (raw & 0xFFFF,)
    assert codec.encode(codec.decode(words)) == words


@given(st.sampled_from(["0.01", "0.001", "i_nom/52428"]), st.floats(-30, 30))
def test_scaling_is_off_by_half_a_step_at_most(scale, value):
    codec = bind(register("i32", scale=scale), {"i_nom": 37.5})
    assert abs(codec.decode(codec.encode(value)) - value) <= codec.resolution(value) * (0.5 + 1e-9)


@given(st.lists(st.integers(0, 0xFFFF), min_size=9, max_size=9), orders)
def test_a_block_decodes_as_its_registers_do(words, order):
    parts = [
        (101, bind(register("f32", order=order), {})),
        (103, bind(register("i16", scale="0.01", invalid=(0x8000,)), {})),
        (105, bind(register("u32", order=order), {})),
    ]
    together = BlockDecoder(100, 9, parts).decode(words)
    alone = [codec.decode(words[at - 100 : at - 100 + codec.words]) for at, codec in parts]
    assert [repr(value) for value in together] == [repr(value) for value in alone]
