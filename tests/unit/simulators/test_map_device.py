"""What reading and writing registers and coils does, without a socket."""

import math
import struct

import pytest

from drivers.register_map import load_map
from simulators.bench import SimulatorSettings, build_device
from simulators.modbus_actions import Action, Frame
from simulators.modbus_refusals import (
    DEVICE_FAILURE,
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    NO_SUCH_UNIT,
    ModbusRefusals,
    RefusedError,
)
from simulators.modbus_requests import Units
from simulators.register_commands import RegisterCommands
from simulators.register_image import RegisterImage
from simulators.registers import RegisterCodec

GENERIC = load_map("generic")


def device(name="generic", **settings):
    return build_device(SimulatorSettings(map_name=name, lock_step=True, **settings))


def f32(value):
    return struct.pack(">f", value)


def refused(code):
    return pytest.raises(RefusedError, check=lambda error: error.code == code)


# --- the image -------------------------------------------------------------------------------------------
def test_a_register_shows_what_it_is_bound_to_and_keeps_what_is_stored():
    image = RegisterImage(GENERIC)
    shown, kept = (RegisterCodec(GENERIC.registers[name], {"i_nom": 30.0}) for name in ("actual_voltage", "watchdog"))
    values = iter((3.5, math.nan, 0.0, -0.0))
    image.show(shown, lambda: next(values))
    image.store(kept, 1.5)
    seen = []
    for _ in range(4):
        image.publish()
        seen.append(image.read("holding", 202, 2))
    assert seen == [f32(3.5), f32(math.nan), f32(0.0), f32(-0.0)]
    assert image.read("holding", 110, 1) == (1500).to_bytes(2, "big")


@pytest.mark.parametrize(("first", "count"), [(9, 1), (8, 2), (5000, 1), (99, 2), (104, 3)])
def test_only_parts_of_one_block_are_read(first, count):
    with refused(ILLEGAL_ADDRESS):
        RegisterImage(GENERIC).read("holding", first, count)
    with refused(ILLEGAL_ADDRESS):
        RegisterImage(GENERIC).read("input", 0, 1)


def test_a_block_of_one_type_takes_no_mixture():
    psb = load_map("ea_psb")
    image = RegisterImage(psb)
    with refused(ILLEGAL_VALUE):
        image.read("holding", 505, 5)  # a u32 and three u16
    assert image.read("holding", 505, 2) + image.read("holding", 507, 3) == bytes(10)


# --- writing ---------------------------------------------------------------------------------------------
def test_set_point_heartbeat_and_tick_in_one_message():
    made = device()
    made.write_coils(0, [True, True])
    made.write(100, f32(2.0) + (7).to_bytes(2, "big") + (1).to_bytes(4, "big"))
    assert (made.cycler.set_point_A, made.clock.tick) == (2.0, 1)
    assert made.read("holding", 208, 2) == f32(2.0) and made.read("holding", 102, 1) == b"\x00\x07"


@pytest.mark.parametrize(
    ("first", "data", "code"),
    [
        (100, f32(0.0) + b"\0\x07" + (9).to_bytes(4, "big"), ILLEGAL_VALUE),  # a tick left out
        (100, f32(31.0) + b"\0\x07", ILLEGAL_VALUE),
        (100, f32(math.nan), ILLEGAL_VALUE),
        (100, f32(1.0)[:2], ILLEGAL_ADDRESS),  # half a value
        (101, f32(1.0)[:2], ILLEGAL_ADDRESS),
        (202, f32(1.0), ILLEGAL_ADDRESS),  # a measurement
    ],
)
def test_a_write_that_is_refused_changes_nothing(first, data, code):
    made = device()
    before = made.read("holding", 100, 6)
    with refused(code):
        made.write(first, data)
    assert made.read("holding", 100, 6) == before and made.cycler.requested_A == 0.0


def test_the_output_needs_remote_control_and_no_alarm():
    made = device()
    with refused(DEVICE_FAILURE):
        made.write_coils(1, [True])
    made.cycler.alarms.add("over_voltage")
    with refused(DEVICE_FAILURE):
        made.write_coils(0, [True, True])
    assert not made.cycler.remote, "refused as a whole"
    made.write_coils(0, [True, True, True])  # the alarm is cleared by the same message
    assert made.read_coils(0, 3) == [True, True, False] and made.cycler.output_on
    with refused(ILLEGAL_ADDRESS):
        made.read_coils(0, 9)


def commands(told, name="generic"):
    made = device(name)
    return made, RegisterCommands(made.map, made.cycler, made.clock, ModbusRefusals(tells_out_of_range=told))


def test_a_device_that_tells_of_no_refusal_passes_over_what_is_out_of_range():
    made, silent = commands(False)
    silent.check("set_current", 1e6)
    limit_A = made.cycler.limits["current_high"]
    assert silent.is_taken("set_charge", limit_A) and not silent.is_taken("set_charge", limit_A + 1.0)
    assert silent.is_taken("set_voltage", 1e6)
    made, plain = commands(True)
    assert plain.is_taken("set_charge", 1e6), "it has been refused before"
    with refused(ILLEGAL_VALUE):
        plain.check("set_current", 1e6)
    with refused(ILLEGAL_VALUE):
        plain.check("set_discharge", 1e6)
    with refused(ILLEGAL_VALUE):
        plain.check("ramp", -1.0)
    with refused(DEVICE_FAILURE):
        plain.check("output", 1.0)


def test_two_directions_make_one_set_point():
    made, plain = commands(True)
    plain.take("set_charge", 3.0)
    plain.take("set_discharge", 1.0)
    plain.take("set_voltage", 4.2)
    assert (made.cycler.requested_A, plain.set_voltage_V) == (2.0, 4.2)


@pytest.mark.parametrize(("written", "ramp"), [(0.0, None), (2.5, 2.5)])
def test_no_ramp_is_zero_in_the_register(written, ramp):
    made, plain = commands(True)
    plain.take("ramp", written)
    assert made.cycler.ramp_A_per_s == ramp
    made.publish()
    assert made.read("holding", 132, 2) == f32(written)


def test_current_that_counts_the_other_way_round_is_turned_on_its_way_in_and_out(tmp_path):
    path = tmp_path / "turned.toml"
    path.write_text(GENERIC.file.read_text().replace('positive_current = "charge"', 'positive_current = "discharge"'))
    made = device(str(path))
    made.write_coils(0, [True, True])
    made.write(100, f32(2.0))
    assert made.cycler.set_point_A == -2.0
    assert made.read("holding", 100, 2) == made.read("holding", 208, 2) == f32(2.0)


def test_status_and_alarms_are_bits():
    made = device()
    made.write_coils(0, [True])
    made.cycler.alarms.add("over_voltage")
    made.publish()
    bits = {role: GENERIC.bits[getattr(GENERIC.by_role(role), "name", "")] for role in ("status", "alarms")}
    status, alarms = struct.unpack(">HH", made.read("holding", 210, 2))
    assert status == sum(1 << bits["status"][name] for name in made.cycler.status | {"lock_step"})
    assert alarms == 1 << bits["alarms"]["over_voltage"]


# --- requests --------------------------------------------------------------------------------------------
def test_a_function_or_a_unit_that_is_not_there():
    units = Units(device(), {7: device()})
    assert units.answer(3, b"\x03\0\0\0\x01") == bytes((0x83, NO_SUCH_UNIT))
    assert units.answer(1, b"\x2b\0\0\0\x01") == bytes((0xAB, ILLEGAL_FUNCTION))
    assert 7 in units and list(units) == [7, 1]
    assert units.answer(7, b"\x03\0\0\0\x01") == b"\x03\x02\x42\x54"
    assert units.answer(1, b"\x03\0\0") == bytes((0x83, ILLEGAL_VALUE)), "cut off"


@pytest.mark.parametrize(
    ("action", "answer", "executed"),
    [
        (Action(), b"answer", True),
        (Action(exception=6), b"\x83\x06", False),
        (Action(echo=True), b"\x03ask", False),
        (Action(execute=False), b"", False),
        (Action(reply=False), b"answer", True),  # the reply is lost on its way
    ],
)
def test_an_action_says_whether_a_request_takes_effect(action, answer, executed):
    done = []

    def execute():
        done.append(True)
        return b"answer"

    assert action.answered(Frame(1, 1, b"\x03ask"), execute) == answer
    assert bool(done) == executed
