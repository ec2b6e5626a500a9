"""What CAN messages of the bench do to a device, and what it tells, frame by frame and without a bus."""

import math

import pytest

from drivers.register_map import load_can_map
from simulators.bench import SimulatorSettings, build_can_device
from simulators.can_commands import CanCommands, CanRefusals
from simulators.can_requests import Asked, Told
from simulators.cycler import CyclerSettings

MAP = load_can_map("generic_can")


def device(name="generic_can", **settings):
    return build_can_device(SimulatorSettings(protocol="can", map_name=name, lock_step=True, **settings))


def sent(made, message, **values):
    """Send physical values, as the bench would."""
    layout = made.layouts[message]
    raws = layout.decode_raw(layout.encode(values))
    return made.answer(message, raws, layout.length)


def told(made, answer):
    ((name, data),) = answer
    return name, made.layouts[name].decode(data)


def test_a_message_is_a_question_or_a_command_by_its_fixed_numbers():
    made = device()
    raws = {"Item": 2.0, "Token": 9.0}
    asked = made.requests.read("Request", raws, 2)
    assert isinstance(asked, Asked) and (asked.ask.name, asked.arguments) == ("nominal", {"token": 9.0})
    command = made.requests.read("Control", {"Item": 2.0, "Value": 1.0}, 2)
    assert isinstance(command, Told) and (command.command.name, command.arguments) == ("output", {"output": 1.0})
    assert made.requests.read("Request", raws | {"Item": 77.0}, 2) is None
    assert made.requests.read("Request", raws, 1) is None, "another length is another message"


def test_only_messages_of_the_bench_are_taken():
    requests = device().requests
    command = requests.layout_of(0x100, extended=False)
    assert command is not None and command.name == "Command"
    assert requests.takes(command, 8) and not requests.takes(command, 7)
    assert requests.layout_of(0x100, extended=True) is None
    assert requests.layout_of(0x104, extended=False) is None, "the device's own"


def test_a_scaled_set_point_is_read_back_to_what_was_meant():
    """The map of the EA PSB sends shares of the rating; its arguments are amperes and volts again."""
    made = device("ea_psb_can")
    for command in made.map.commands.values():
        layout = made.layouts[command.send.message]
        known = made.cycler.settings.constants
        names = {name for e in command.send.values.values() for name in e.names} - known.keys()
        arguments = dict.fromkeys(names, 1.0)
        raws = {
            signal: expression.evaluate({**known, **arguments}) for signal, expression in command.send.values.items()
        }
        length = command.send.length or layout.length
        found = made.requests.read(layout.name, dict.fromkeys(layout.signals, 0.0) | raws, length)
        assert isinstance(found, Told) and dict(found.arguments) == pytest.approx(arguments)


def test_a_command_is_taken_as_a_whole_and_repeated():
    made = device()
    sent(made, "Control", Item=1, Value=1)
    sent(made, "Control", Item=2, Value=1)
    name, values = told(made, sent(made, "Command", SetCurrent=-2.5, Heartbeat=7, Tick=1))
    assert (name, values) == ("CommandEcho", pytest.approx({"SetCurrent": -2.5, "Heartbeat": 7, "Tick": 1}))
    assert made.cycler.set_point_A == -2.5 and made.clock.tick == 1


@pytest.mark.parametrize(
    ("message", "values", "code"),
    [
        ("Request", {"Item": 77}, 1),
        ("Control", {"Item": 2, "Value": 1}, 2),  # the output without remote control
        ("Command", {"SetCurrent": 1000.0 / 3}, 3),  # beyond the rating
        ("Command", {"SetCurrent": 0.0, "Tick": 5}, 3),  # a tick left out
        ("Setting", {"Item": 1, "Value": 0.0}, 3),  # no time at all for the watchdog
        ("Setting", {"Item": 9, "Value": -1.0}, 3),
        ("Setting", {"Item": 3, "Value": math.nan}, 3),
    ],
)
def test_what_is_refused_changes_nothing(message, values, code):
    made = device()
    before = (made.cycler.requested_A, made.cycler.output_on, made.cycler.watchdog_s, made.clock.tick)
    limits = dict(made.cycler.limits)
    assert told(made, sent(made, message, **values)) == ("Refused", {"Code": code})
    assert before == (made.cycler.requested_A, made.cycler.output_on, made.cycler.watchdog_s, made.clock.tick)
    assert limits == made.cycler.limits


def test_each_device_says_no_with_its_own_codes():
    made = device("ea_psb_can")
    commands = CanCommands(made.map, made.cycler, made.clock, CanRefusals(wrong_state=7, out_of_range=33))
    made.cycler.set_remote(False)
    assert commands.execute("output", {"output": 1.0}) == 7
    assert commands.execute("set", {"set_current": 1e6}) == 33


class Awake:
    """Counts heartbeats in place of a cycler's watchdog."""

    def __init__(self, cycler, monkeypatch):
        self.count = 0
        monkeypatch.setattr(cycler, "heartbeat", self.beat)

    def beat(self):
        self.count += 1


def test_only_a_heartbeat_keeps_a_device_awake_that_has_one(monkeypatch):
    made = device()
    awake = Awake(made.cycler, monkeypatch)
    sent(made, "Control", Item=1, Value=1)
    sent(made, "Request", Item=3, Token=1)
    assert awake.count == 0
    sent(made, "Command", SetCurrent=0.0, Heartbeat=1, Tick=0)
    assert awake.count == 1


def test_any_command_keeps_a_device_awake_that_has_no_heartbeat(monkeypatch):
    made = device("meanwell_bic2200_24")
    awake = Awake(made.cycler, monkeypatch)
    assert made.commands.execute("output", {"output": 0.0}) is None
    assert made.commands.execute("set", {"set_current": 1e6}) is not None, "refused, but heard"
    assert awake.count == 2


def test_current_that_counts_the_other_way_round_is_turned_on_its_way_in_and_out(tmp_path):
    text = (MAP.file).read_text().replace('positive_current = "charge"', 'positive_current = "discharge"')
    (tmp_path / "generic_can.dbc").write_text(MAP.dbc.read_text())
    path = tmp_path / "turned.toml"
    path.write_text(text)
    made = device(str(path))
    sent(made, "Control", Item=1, Value=1)
    sent(made, "Control", Item=2, Value=1)
    sent(made, "Command", SetCurrent=2.0, Heartbeat=1, Tick=1)
    assert made.cycler.set_point_A == -2.0
    layout = made.layouts["Condition"]
    assert layout.decode(made.message("Condition"))["SetpointInForce"] == 2.0


def test_an_answer_carries_the_token_of_its_question_and_a_missing_value_its_pattern():
    made = device()
    made.cycler.measurement = made.cycler.measurement._replace(voltage_V=math.nan, current_A=1.5)
    answers = dict(sent(made, "Request", Item=3, Token=9))
    assert set(answers) == {"Electrical", "Condition", "State"}
    raws = made.layouts["Electrical"].decode_raw(answers["Electrical"])
    assert (raws["Token"], raws["Voltage"], raws["Current"]) == (9, 0xFFFFFF, 15000)


def test_flags_and_alarms_stand_in_the_status():
    made = device(cycler=CyclerSettings(nominal_current_A=30.0))
    sent(made, "Control", Item=1, Value=1)
    made.cycler.alarms.add("over_voltage")
    values = made.layouts["State"].decode(made.message("State"))
    assert {name for name, value in values.items() if value == 1} == {"Remote", "LockStep", "OverVoltage"}
