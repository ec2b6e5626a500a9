"""Fault scripts: what is understood, when a fault begins and ends, and what it does to device and cell."""

import math

import pytest

from drivers.register_map import load_can_map, load_map
from simulators.cell import CellOutput
from simulators.cycler import Cycler, CyclerSettings
from simulators.fault_hooks import CanFaults, ModbusFaults
from simulators.faults import KINDS, Fault, FaultEngine, FaultyCell, FaultySensors, parse_faults
from simulators.modbus_actions import Frame
from simulators.sensors import SensorParameters, Sensors

GENERIC, GENERIC_CAN = load_map("generic"), load_can_map("generic_can")


class Resistor:
    """4 V behind 0.1 ohm, at 25 degC."""

    def step(self, current_A, dt_s):
        return CellOutput(4.0 + 0.1 * current_A, 25.0, 0.5, 4.0, 0.0, 0.0)


class Exact:
    """Sensors without noise."""

    def standard_normal(self, count):
        import numpy as np

        return np.zeros(count)


def device(script):
    engine = FaultEngine(parse_faults(script))
    sensors = FaultySensors(Sensors(SensorParameters(), Exact()), engine)
    cycler = Cycler(CyclerSettings(), FaultyCell(Resistor(), engine), sensors, watchdog_enabled=True)
    engine.bind(cycler)
    cycler.set_remote(True)
    cycler.set_output(True)
    cycler.set_current(2.0)
    return cycler, engine


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("silence@sample:30", Fault("silence", "sample", 30.0, 0.0, messages=1)),
        ("late=0.4@t:12.5x3", Fault("late", "t", 12.5, 0.4, messages=3)),
        ("slow=0.05@message:1", Fault("slow", "message", 1.0, 0.05)),
        ("nan.current@t:1+3", Fault("nan", "t", 1.0, 0.0, "current", seconds=3.0)),
        ("jump.temperature=-20@set_point:2", Fault("jump", "set_point", 2.0, -20.0, "temperature")),
        ("restart@output_on:1", Fault("restart", "output_on", 1.0, 0.0)),
        ("sentinel@t:0", Fault("sentinel", "t", 0.0, 9.91e37)),
    ],
)
def test_what_is_understood(text, fault):
    assert parse_faults(text) == (fault,)


def test_several_faults():
    assert [fault.kind for fault in parse_faults(" drop@t:1;\n stuck@t:2 ;; ")] == ["drop", "stuck"]
    assert parse_faults("") == ()
    assert all(parse_faults(f"{kind}@t:1")[0].value == value for kind, value in KINDS.items())


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("silence", "write KIND"),
        ("earthquake@t:1", "unknown kind 'earthquake'"),
        ("nan.charm@t:1", "unknown quantity 'charm'"),
        ("drop@noon:1", "unknown event 'noon'"),
        ("late=..@t:1", "a number cannot be read"),
    ],
)
def test_what_is_refused(text, reason):
    with pytest.raises(ValueError, match=reason):
        parse_faults(text)


def test_a_fault_of_an_event_begins_with_it_and_lasts_its_messages():
    engine = FaultEngine(parse_faults("silence@sample:3x2"))
    met = [
        bool(engine.message(events)) for events in (["sample"], ["sample"], [], ["sample"], [], ["sample"], ["sample"])
    ]
    assert met == [False, False, False, True, False, True, False]
    assert [fault.kind for fault in engine.begun] == ["silence"]


def test_a_fault_of_time_takes_whatever_message_comes():
    engine = FaultEngine(parse_faults("drop@t:1x5+2"))
    assert not engine.message([])
    engine.advance(1.0)
    assert engine.message([]) and engine.message(["sample"])
    engine.advance(2.5)
    assert not engine.message([])


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("nan@t:1", math.nan),
        ("sentinel@t:1", 9.91e37),
        ("jump=10@t:1", 14.2),
        ("reversed@t:1", -4.2),
    ],
)
def test_values_that_are_wrong(script, expected):
    cycler, _ = device(script)
    cycler.limits |= {"voltage_high": 1e38, "voltage_low": -1e38}
    cycler.advance(0.5)
    assert cycler.measurement.voltage_V == pytest.approx(4.2)
    cycler.advance(0.6)
    assert cycler.measurement.voltage_V == pytest.approx(expected, nan_ok=True)
    assert cycler.measurement.current_A == pytest.approx(2.0)
    assert cycler._sensors.honest.voltage_V == pytest.approx(4.2)


def test_a_value_is_stuck_while_the_rest_goes_on():
    cycler, _ = device("stuck@t:0.5+1")
    cycler.advance(0.6)
    cycler.set_current(-2.0)
    cycler.advance(0.1)
    assert (cycler.measurement.voltage_V, cycler.measurement.current_A, cycler.sequence) == (4.2, -2.0, 2)
    cycler.advance(1.0)
    assert cycler.measurement.voltage_V == pytest.approx(3.8)


def test_a_frozen_device_counts_no_further():
    cycler, _ = device("frozen@t:0.5+1")
    for _ in range(3):
        cycler.advance(0.4)
    assert cycler.sequence == 1
    cycler.advance(1.0)
    assert cycler.sequence == 2


def test_a_restart_forgets_everything():
    cycler, _ = device("restart@t:1")
    cycler.set_limit("voltage_high", 4.3)
    cycler.advance(0.5)
    cycler.alarms.add("internal")
    cycler.advance(1.0)
    assert (cycler.output_on, cycler.remote, cycler.set_point_A, cycler.current_A) == (False, False, 0.0, 0.0)
    assert cycler.limits["voltage_high"] == 6.0 and not cycler.alarms and cycler.sequence <= 1


def test_a_watchdog_that_fires():
    cycler, _ = device("watchdog@t:1")
    cycler.advance(1.5)
    assert cycler.alarms == {"watchdog"} and not cycler.output_on


def test_set_points_that_are_not_taken():
    cycler, engine = device("refused@set_point:2")
    engine.message(["set_point"])
    cycler.set_current(1.0)
    engine.message(["set_point"])
    cycler.set_current(3.0)
    assert cycler.requested_A == 1.0


def test_a_cell_that_warms_up_and_one_that_shorts():
    cycler, _ = device("over_temperature=5@t:1")
    cycler.advance(1.0)
    cycler.advance(2.0)
    assert cycler.measurement.temperature_degC == pytest.approx(25.0 + 5.0 * 3.0)
    cycler, _ = device("short=1@t:0.5")
    cycler.advance(0.5)
    cycler.advance(0.5)
    assert cycler.measurement.voltage_V < 4.0 and cycler.measurement.current_A == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("pdu", "events"),
    [
        ("03 00C8 000C", {"sample"}),
        ("03 0000 0001", set()),
        ("10 0064 0005 0A 4020 0000 0201 0001 0001", {"set_point"}),
        ("17 00C8 000C 0064 0005 0A 4020 0000 0201 0001 0001", {"sample", "set_point"}),
        ("05 0001 FF00", {"output_on"}),
        ("05 0001 0000", set()),
        ("06", set()),
    ],
)
def test_messages_of_modbus_are_known_by_the_map(pdu, events):
    assert ModbusFaults(GENERIC, FaultEngine(()))._events(Frame(0, 1, bytes.fromhex(pdu))) == events


@pytest.mark.parametrize(
    ("message", "raws", "events"),
    [
        ("Request", {"Item": 3, "Token": 1}, {"sample"}),
        ("Request", {"Item": 1, "Token": 1}, set()),
        ("Command", {"SetCurrent": 0, "Heartbeat": 1, "Tick": 1}, {"set_point"}),
        ("Control", {"Item": 2, "Value": 1}, {"output_on"}),
        ("Control", {"Item": 2, "Value": 0}, set()),
        ("Control", {"Item": 1, "Value": 1}, set()),
    ],
)
def test_messages_of_can_are_known_by_the_map(message, raws, events):
    assert CanFaults(GENERIC_CAN, FaultEngine(()))._events(message, raws) == events
