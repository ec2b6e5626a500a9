"""Every CAN map that comes with the program: it loads, fits its DBC, and its sample frames mean what they say."""

import pytest

from drivers.can_codec import CanCodec
from drivers.can_plan import CanPlan
from drivers.map_frames import check_frames
from drivers.register_map import list_maps, load_can_map
from simulators.can_dbc import read_dbc

maps = pytest.mark.parametrize("name", list_maps("can"))
frames = pytest.mark.parametrize(
    ("name", "index"), [(name, i) for name in list_maps("can") for i in range(len(load_can_map(name).frames))]
)


def length(can_map, message, longest):
    """Return how many bytes a message has: a view may be shorter than its message."""
    view = can_map.views.get(message)
    return view.length or longest if view else longest


@maps
def test_it_loads_and_can_be_planned(name):
    can_map = load_can_map(name)
    assert can_map.name == name and can_map.source
    plan = CanPlan(can_map, CanCodec(can_map.dbc, can_map.views), dict.fromkeys(can_map.constants, 100.0))
    low_A, high_A = plan.capabilities({"serial": ""}, lock_step=False).current_A
    assert low_A < 0 < high_A
    assert can_map.sampled


@maps
def test_it_has_frames_both_ways(name):
    can_map = load_can_map(name)
    sent = {command.send.message for command in can_map.commands.values()}
    shown = {can_map.base(frame.message) for frame in can_map.frames}
    assert shown & sent and shown - sent
    assert check_frames(can_map) == len(can_map.frames)


@frames
def test_frame_decodes_to_its_meaning_by_both_codecs(name, index):
    can_map = load_can_map(name)
    frame = can_map.frames[index]
    driver, simulator = CanCodec(can_map.dbc, can_map.views), read_dbc(can_map.dbc)[can_map.base(frame.message)]
    physical = driver.physical(frame.message, driver.raw(frame.message, frame.data))
    assert simulator.id == frame.id and len(frame.data) == length(can_map, frame.message, simulator.length)
    other = simulator.decode(frame.data)
    for signal, value in frame.values.items():
        assert physical[signal] == pytest.approx(value, rel=1e-6, abs=1e-9), signal
        assert other[signal] == pytest.approx(value, rel=1e-6, abs=1e-9), signal


@frames
def test_frame_encodes_from_its_meaning_by_both_codecs(name, index):
    can_map = load_can_map(name)
    frame = can_map.frames[index]
    codec, layout = CanCodec(can_map.dbc, can_map.views), read_dbc(can_map.dbc)[can_map.base(frame.message)]
    size = length(can_map, frame.message, layout.length)
    assert codec.encode(frame.message, frame.values)[:size] == frame.data
    assert layout.encode(frame.values)[:size] == frame.data
