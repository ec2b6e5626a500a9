"""What goes out with a tick, and what a sample is made of, for maps of both kinds."""

import math
from dataclasses import replace

import pytest

from drivers.codec import bind_all
from drivers.device_map import TYPE_WORDS
from drivers.errors import SetPointRefusedError
from drivers.expression import parse_expression
from drivers.modbus_commands import CommandPlan, DirectionPlan, contiguous
from drivers.modbus_plan import DevicePlan
from drivers.modbus_sample import SamplePlan
from drivers.register_map import load_map
from drivers.setpoint_watch import SetPointWatch

GENERIC, PSB = load_map("generic"), load_map("ea_psb")
CONSTANTS = {"i_nom": 30.0, "v_nom": 6.0, "p_nom": 180.0}
VOLTAGES = (2.5, 4.2)


def test_registers_that_lie_together_go_out_together():
    registers = [GENERIC.registers[name] for name in ("set_current", "heartbeat", "lock_step", "watchdog")]
    grouped = contiguous(registers, single=False)
    assert [label for _, label in grouped] == ["'set_current', 'heartbeat', 'lock_step'", "'watchdog'"]
    assert len(contiguous(registers, single=True)) == 4
    assert contiguous([], single=False) == []


def test_set_point_heartbeat_and_tick_are_one_message():
    plan = CommandPlan(GENERIC, bind_all(GENERIC, CONSTANTS))
    (timed,) = plan.writes(1.0, 7, 65537, VOLTAGES)
    assert (timed.first, timed.values) == (100, (0x3F80, 0x0000, 7, 1, 1))
    (untimed,) = plan.writes(1.0, 7, None, VOLTAGES)
    assert untimed.values == (0x3F80, 0x0000, 7), "on the wall clock there is no tick"
    assert plan.heartbeat_modulus == 65536 and plan.range_A == (-30.0, 30.0)


@pytest.mark.parametrize("current_A", [math.nan, math.inf, 30.1, -30.1])
def test_a_set_point_that_cannot_be_is_not_sent(current_A):
    for device_map, plan in ((GENERIC, CommandPlan), (PSB, DirectionPlan)):
        with pytest.raises(SetPointRefusedError, match="not sent"):
            plan(device_map, bind_all(device_map, CONSTANTS)).writes(current_A, 0, None, VOLTAGES)


@pytest.mark.parametrize("current_A", [3.0, -3.0])
def test_the_direction_that_is_not_wanted_goes_to_zero_first(current_A):
    plan = DirectionPlan(PSB, bind_all(PSB, CONSTANTS))
    order = [write.label.strip("'") for write in plan.writes(current_A, 0, None, VOLTAGES)]
    roles = [PSB.registers[name].role for name in order]
    wanted = ["set_discharge", "set_charge"] if current_A > 0 else ["set_charge", "set_discharge"]
    assert [role for role in roles if role != "set_voltage"] == wanted
    assert plan.rounded(current_A) == pytest.approx(current_A, abs=0.001)


def test_all_set_points_that_can_be_read_are_read_back_when_control_is_taken():
    plan = CommandPlan(GENERIC, bind_all(GENERIC, CONSTANTS))
    assert [write.first for write in plan.read_back(0.0, every=True)] == [100]
    assert plan.read_back(0.0, every=False) == [], "another register shows what is in force"


def test_a_role_that_the_map_lacks_is_missing_in_the_sample():
    riden = load_map("riden_rd6006")
    plan = SamplePlan(riden, bind_all(riden, {}))
    blocks = [[0] * read.count for read in plan.reads]
    reading = plan.reading(1.0, 40, blocks)
    assert not plan.has_sequence and reading.sequence == 41
    assert math.isnan(reading.setpoint_in_force_A) and math.isnan(reading.ambient_degC)


@pytest.mark.parametrize(("kind", "modulus"), [("u16", 2**16), ("i16", 2**16), ("u32", 2**32)])
def test_a_set_point_that_is_written_before_a_short_counter_wraps_is_waited_for(kind, modulus):
    counter = replace(GENERIC.by_role("sequence"), type=kind, words=TYPE_WORDS[kind])
    plan = DevicePlan(replace(GENERIC, registers=GENERIC.registers | {counter.name: counter}), CONSTANTS)

    def sequence_of(raw, last):
        blocks = []
        for read in plan.sample.reads:
            blocks.append(words := [0] * read.count)
            if counter in read.registers:
                parts = [raw % modulus >> 16 * k & 0xFFFF for k in reversed(range(counter.words))]
                at = counter.address - read.first
                words[at : at + counter.words] = parts
        return plan.sample.reading(0.0, last, blocks).sequence

    before = sequence_of(modulus - 1, modulus - 3)
    after = sequence_of(0, before)
    assert (before, after) == (modulus - 1, modulus % 2**32)
    assert sequence_of(0, after) == after, "a stale reading stays one"
    watch = SetPointWatch(exact=False)
    watch.written(1.0, 0.0, before - 5)
    watch.written(2.0, 0.0, before)
    assert watch.check(1.0, after) is None, "a whole tick has not passed"
    assert watch.check(1.0, sequence_of(1, after)) == 2.0


def test_bits_without_a_name_are_never_dropped():
    plan = DevicePlan(GENERIC, CONSTANTS)
    (read,) = plan.sample.reads
    words = [0] * read.count
    alarms = GENERIC.by_role("alarms")
    assert alarms is not None
    words[alarms.address - read.first] = 1 << 15
    assert plan.sample.reading(0.0, 0, [words]).alarms == {"bit_15"}


@pytest.mark.parametrize(
    ("kind", "scale", "watchdog_s", "written"),
    [
        ("u16", "1", 0.4, "0 s"),
        ("u16", "1", 1.6, "2 s"),
        ("u16", "0.5", 0.2, "0 s"),
        ("u16", "0.5", 0.8, "1 s"),
        ("u16", "1", 1.0, None),
        ("u16", "1", 1.4, None),  # shorter than asked for
        ("u16", "0.001", 0.4, None),
        ("f32", None, 0.4, None),
    ],
)
def test_a_watchdog_that_is_rounded_to_none_or_to_a_longer_one_is_refused(kind, scale, watchdog_s, written):
    register = GENERIC.by_role("watchdog")
    change = {"type": kind, "words": TYPE_WORDS[kind], "scale": scale and parse_expression(scale), "range": None}
    changed = replace(GENERIC, registers=GENERIC.registers | {register.name: replace(register, **change)})
    plan = DevicePlan(changed, CONSTANTS)
    if written is None:
        plan.check_watchdog(changed.by_role("watchdog"), watchdog_s)
        return
    with pytest.raises(SetPointRefusedError, match=f"'watchdog': a watchdog of {watchdog_s:g} s would be .* {written}"):
        plan.check_watchdog(changed.by_role("watchdog"), watchdog_s)
