"""The simulators' own DBC reader against cantools, for every kind of signal."""

import math

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.register_map import MAPS
from simulators.can_dbc import read_dbc

DBC = """\
VERSION ""
BU_: A B
BO_ 100 Mixed: 8 A
 SG_ Low : 0|12@1+ (0.5,-10) [0|0] "V" B
 SG_ Signed : 12|12@1- (2,0) [0|0] "A" B
 SG_ Motorola : 31|16@0- (0.25,1) [0|0] "W" B
 SG_ Nibble : 43|4@0+ (1,0) [0|0] "" B
BO_ 2566844672 Wide: 12 A
 SG_ Single : 0|32@1- (1,0) [0|0] "" B
 SG_ Double : 32|64@1- (1,0) [0|0] "" B
SIG_VALTYPE_ 2566844672 Single : 1;
SIG_VALTYPE_ 2566844672 Double : 2;
"""


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    path = tmp_path_factory.mktemp("dbc") / "mixed.dbc"
    path.write_text(DBC)
    return read_dbc(path), cantools.database.load_file(path)


@given(data=st.binary(min_size=8, max_size=8))
def test_every_signal_decodes_alike(both, data):
    own, other = both
    assert own["Mixed"].decode(data) == pytest.approx(other.get_message_by_name("Mixed").decode(data))


@given(
    low=st.integers(0, 4095), signed=st.integers(-2048, 2047), motorola=st.integers(-32768, 32767),
    nibble=st.integers(0, 15),
)  # fmt: skip
def test_every_signal_encodes_alike(both, low, signed, motorola, nibble):
    own, other = both
    raws = {"Low": low, "Signed": signed, "Motorola": motorola, "Nibble": nibble}
    assert own["Mixed"].encode_raw(raws) == other.get_message_by_name("Mixed").encode(raws, scaling=False)
    assert own["Mixed"].decode_raw(own["Mixed"].encode_raw(raws)) == raws


@given(single=st.floats(width=32), double=st.floats())
def test_floating_point(both, single, double):
    own, other = both
    wide = own["Wide"]
    assert wide.extended and wide.id == other.get_message_by_name("Wide").frame_id and wide.length == 12
    data = wide.encode({"Single": single, "Double": double})
    found = wide.decode(data)
    for name, value in (("Single", single), ("Double", double)):
        assert found[name] == value or (math.isnan(found[name]) and math.isnan(value))
    if math.isfinite(single) and math.isfinite(double):
        assert other.get_message_by_name("Wide").decode(data) == found


def test_whole_numbers_saturate(both):
    own, _ = both
    assert own["Mixed"].decode_raw(own["Mixed"].encode_raw({"Low": 9999, "Signed": -9999})) == {
        "Low": 4095, "Signed": -2048, "Motorola": 0, "Nibble": 0,
    }  # fmt: skip


def test_signals_of_the_maps_that_come_with_the_program():
    for path in MAPS.glob("*.dbc"):
        own, other = read_dbc(path), cantools.database.load_file(path)
        assert set(own) == {message.name for message in other.messages}
        for message in other.messages:
            layout = own[message.name]
            assert (layout.id, layout.length, layout.extended) == (
                message.frame_id, message.length, message.is_extended_frame,
            )  # fmt: skip
            data = bytes(range(3, 3 + message.length))
            for chosen in variants(layout, message, data):
                decoded = layout.decode_raw(chosen)
                there = message.decode(chosen, scaling=False, decode_choices=False)
                assert {name: decoded[name] for name in there} == pytest.approx(there)
                assert set(there) == set(decoded) or message.is_multiplexed()


def variants(layout, message, data):
    """The data, with every value of the multiplexer where the message has one."""
    selector = next((signal for signal in message.signals if signal.is_multiplexer), None)
    if selector is None:
        return [data]
    chosen = sorted({number for signal in message.signals for number in signal.multiplexer_ids or ()})
    mask = int.from_bytes(layout.encode_raw({selector.name: (1 << selector.length) - 1}), "little")
    kept = int.from_bytes(data, "little") & ~mask
    return [
        (kept | int.from_bytes(layout.encode_raw({selector.name: number}), "little")).to_bytes(message.length, "little")
        for number in chosen
    ]
