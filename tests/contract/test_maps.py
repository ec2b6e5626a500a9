"""Every device map that comes with the program: it loads, and its sample frames mean what they say."""

import math
import struct

import pytest

from drivers.codec import bind_all
from drivers.map_frames import check_frames
from drivers.modbus_plan import DevicePlan
from drivers.register_map import list_maps, load_map

# Nominal values as a device would report them, for maps that scale by them.
NOMINAL = 100.0

maps = pytest.mark.parametrize("name", list_maps("modbus"))


def frames(*functions):
    """Parametrise by the sample frames whose request has one of some functions."""
    every = [(name, i, frame) for name in list_maps("modbus") for i, frame in enumerate(load_map(name).frames)]
    return pytest.mark.parametrize(("name", "index"), [(n, i) for n, i, f in every if f.request[0] in functions])


def words(data):
    return list(struct.unpack(f">{len(data) // 2}H", data))


def codecs_of(device_map):
    return bind_all(device_map, dict.fromkeys(device_map.constants, NOMINAL))


def covered(device_map, first, count):
    """Registers of the map that lie in a message as a whole."""
    inside = [r for r in device_map.registers.values() if first <= r.address and r.end <= first + count]
    return sorted(inside, key=lambda r: r.address)


def written_frame(device_map, codecs, frame):
    """Build the request of a writing frame from its values alone."""
    if coil := next((device_map.coils[n] for n in frame.values if n in device_map.coils), None):
        return struct.pack(">BHH", 5, coil.address, 0xFF00 if frame.values[coil.name] else 0)
    registers = sorted((device_map.registers[n] for n in frame.values), key=lambda r: r.address)
    payload = [word for r in registers for word in codecs[r.name].encode(frame.values[r.name])]
    data = struct.pack(f">{len(payload)}H", *payload)
    if frame.request[0] == 6:
        return struct.pack(">BH", 6, registers[0].address) + data
    return struct.pack(">BHHB", 16, registers[0].address, len(payload), len(data)) + data


@maps
def test_its_frames_pass_the_check_that_users_have(name):
    device_map = load_map(name)
    assert check_frames(device_map) == len(device_map.frames) > 0


@maps
def test_it_loads_and_can_be_planned(name):
    device_map = load_map(name)
    assert device_map.name == name
    assert device_map.source
    plan = DevicePlan(device_map, dict.fromkeys(device_map.constants, NOMINAL))
    assert plan.sample.reads
    low_A, high_A = plan.capabilities({"serial": ""}, lock_step=False).current_A
    assert low_A <= 0 < high_A  # a plain supply only charges


@maps
def test_it_has_frames_to_read_and_to_write(name):
    functions = {frame.request[0] for frame in load_map(name).frames}
    assert functions & {3, 4} and functions & {5, 6, 16}
    assert functions <= load_map(name).functions
    assert functions <= {3, 4, 5, 6, 16}, "the tests below know no other frames"


@frames(3, 4)
def test_frame_decodes_to_its_meaning(name, index):
    device_map = load_map(name)
    frame, codecs = device_map.frames[index], codecs_of(device_map)
    first, count = struct.unpack(">HH", frame.request[1:])
    assert frame.reply[:2] == bytes([frame.request[0], 2 * count])
    registers = words(frame.reply[2:])
    assert len(registers) == count
    seen = set()
    for register in covered(device_map, first, count):
        raw = registers[register.address - first : register.end - first]
        value = codecs[register.name].decode(raw)
        seen.add(register.name)
        if register.name in frame.missing:
            assert math.isnan(value)
        else:
            # The nearest value the register can hold is this raw value, and no other.
            assert list(codecs[register.name].encode(frame.values[register.name])) == raw, register.name
            assert value == pytest.approx(frame.values[register.name], rel=1e-6, abs=1e-9)
    assert seen == set(frame.values) | set(frame.missing)


@frames(5, 6, 16)
def test_frame_encodes_from_its_meaning(name, index):
    device_map = load_map(name)
    frame = device_map.frames[index]
    assert written_frame(device_map, codecs_of(device_map), frame) == frame.request
    assert frame.reply == frame.request[:5]


def test_the_generic_frames_were_computed_by_hand():
    """The same numbers, written out: the map's frames are checked against arithmetic, not against the codec."""
    read, write = load_map("generic").frames
    three_point_seven = 0b0_10000000_11011001100110011001101  # 3.7 = 1.85 * 2, mantissa 0.85 * 2**23 rounded
    minus_twelve_and_half = 0b1_10000010_10010000000000000000000  # -1.5625 * 8
    expected = struct.pack(
        ">BBIIIHHIHH",
        3, 24, 7, three_point_seven, minus_twelve_and_half, 2531, 0x8000, minus_twelve_and_half, 0b11, 0,
    )  # fmt: skip
    assert read.request == struct.pack(">BHH", 3, 200, 12)
    assert read.reply == expected
    two_and_half = 0b0_10000000_01000000000000000000000  # 1.25 * 2
    assert write.request == struct.pack(">BHHBIHI", 16, 100, 5, 10, two_and_half, 513, 65537)
