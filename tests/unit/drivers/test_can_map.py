"""What is wrong with a CAN map is told by file, key and reason."""

from dataclasses import FrozenInstanceError

import pytest

from drivers.can_codec import CanCodec
from drivers.can_map import Flag, SignalName
from drivers.can_plan import CanPlan, limit_arguments, with_directions
from drivers.cycler import DeviceLimits
from drivers.errors import BadMapError, SetPointRefusedError
from drivers.register_map import MAPS, list_maps, load_can_map, load_map, map_transport

TEXT = (MAPS / "generic_can.toml").read_text()
DBC = (MAPS / "generic_can.dbc").read_text()


def write(tmp_path, old="", new="", dbc=DBC):
    """Write the generic map with some text exchanged."""
    assert TEXT.count(old) >= 1
    (tmp_path / "generic_can.dbc").write_text(dbc)
    path = tmp_path / "changed.toml"
    path.write_text(TEXT.replace(old, new, 1))
    return path


def test_the_map_that_comes_with_the_program():
    assert "generic_can" in list_maps("can") and "generic_can" not in list_maps("modbus")
    assert set(list_maps()) == set(list_maps("can")) | set(list_maps("modbus"))
    assert (map_transport("generic_can"), map_transport("generic")) == ("can", "modbus")
    can_map = load_can_map("generic_can")
    assert can_map.sampled == ("Condition", "Electrical", "State")
    assert can_map.ask_for("State") is can_map.asks["sample"] and can_map.ask_for("Refused") is None
    with pytest.raises(FrozenInstanceError):
        can_map.name = "x"
    with pytest.raises(BadMapError, match="transport: must be one of modbus"):
        load_map("generic_can")


@pytest.mark.parametrize(
    ("old", "new", "key", "reason"),
    [
        ("schema = 1", "schema = 9", "schema", "reads schema 1"),
        ('dbc = "generic_can.dbc"', 'dbc = "none.dbc"', "(file)", "does not exist"),
        ("fd = false", "fd = 0", "fd", "must be true or false"),
        ("node_step = 16", "nodes = 16", "nodes", "not a known key"),
        ('"Info.DeviceClass"', '"DeviceClass"', "identity.signal", "must be written Message.Signal"),
        ('"Info.DeviceClass"', '"Info.Class"', "identity.signal", "'Info.Class', which generic_can.dbc does not have"),
        ('"Info.DeviceClass"', '"Who.Class"', "identity.signal", "message 'Who', which"),
        ('i_nom = "Nominal.Current"', 'i_nom = "Electrical.Amps"', "const.i_nom", "does not have"),
        ('i_nom = "Nominal.Current"', "i_nom = 30", "const.i_nom", "must be written Message.Signal"),
        ('current = ["-i_nom", "i_nom"]', 'current = ["-i_max", "i_nom"]', "capabilities.current[0]", "i_max"),
        ('replies = ["Info"]', "replies = []", "ask.info.replies", "at least one"),
        ('replies = ["Info"]', "replies = [1]", "ask.info.replies", "list of names"),
        ('replies = ["Info"]', 'replies = ["Command"]', "ask.info.replies", "is sent by the bench"),
        ('replies = ["Nominal"]', 'replies = ["Info"]', "ask", "no question is answered with 'Nominal'"),
        ('SetCurrent = "set_current"', 'SetCurrent = "set_power"', "values.SetCurrent", "set_power"),
        ('SetCurrent = "set_current"', 'Current = "set_current"', "values.Current", "has no such signal"),
        ('SetCurrent = "set_current"', 'SetCurrent = "__import__(1)"', "values.SetCurrent", "Call is not allowed"),
        ("values = { Item = 1, Value = \"remote\" }", "values = { Item = 999, Value = \"remote\" }", "Item", "999"),
        ('echo = "CommandEcho"', 'echo = "Echo"', "command.setpoint.echo", "does not have"),
        ('echo = "CommandEcho"', 'echo = "CommandEcho"\nask = "sample"', "setpoint.echo", "not answered with"),
        ('echo = "CommandEcho"', 'echo = "CommandEcho"\nask = "why"', "setpoint.ask", "no question 'why'"),
        ('echo = "CommandEcho"', 'echo = "CommandEcho"\nsame = ["Item"]', "setpoint.same", "not in both"),
        ("[role.actual_voltage]", "[role.voltage]", "role.voltage", "is no role"),
        ("[role.actual_voltage]", "[role.lock_step]", "role", "no role 'actual_voltage'"),
        ("invalid = [0xFFFFFF]", 'invalid = ["all"]', "role.actual_voltage.invalid", "raw numbers"),
        ('output_on = "State.OutputOn"', 'on = "State.OutputOn"', "status", "needs a flag 'output_on'"),
        ('output_on = "State.OutputOn"', 'output_on = { signal = "State.Nope" }', "status.output_on", "either the raw"),
        ('1 = "no such item"', 'one = "no such item"', "refusal.reasons", "by decimal code"),
        ('tick = [{ command = "setpoint" }]', "tick = []", "sequence.tick", "must send"),
        ('tick = [{ command = "setpoint" }]', 'tick = [{ command = "x" }]', "sequence.tick[0]", "no command 'x'"),
        ('command = "output", output = false', 'command = "output", output = true', "sequence.safe", "output on"),
        ('command = "output", output = false', 'command = "output", power = false', "safe[0].power", "one of"),
        ('safe = [{ command = "output", output = false }]', "safe = []", "sequence.safe", "must send output"),
        ("[token]\n", "[view.X]\nmessage = 'No'\nwhere = { Item = 1 }\n[token]\n", "view.X.message", "has no message"),
        ("[token]\n", "[view.State]\nmessage = 'Info'\nwhere = { Token = 1 }\n[token]\n", "view.State", "of that name"),
        ("[token]\n", "[view.X]\nmessage = 'Info'\nwhere = { No = 1 }\n[token]\n", "view.X.where.No", "no such signal"),
        ("[token]\n", "[view.X]\nmessage = 'Info'\nwhere = {}\n[token]\n", "view.X.where", "whole raw numbers"),
        ("id = 0x100", "id = 0x101", "frame[0].id", "the DBC says 0x100"),
        ('message = "Command"\n', 'message = "Nothing"\n', "frame[0].message", "no message 'Nothing'"),
        ("values = { SetCurrent = -2.5", "values = { Amps = -2.5", "frame[0].values.Amps", "no such signal"),
        ('data = "589EFF', 'data = "589EFX', "frame[0].data", "hexadecimal"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told(tmp_path, old, new, key, reason):
    with pytest.raises(BadMapError) as caught:
        load_can_map(write(tmp_path, old, new))
    assert key in caught.value.key and reason in caught.value.reason, str(caught.value)


def test_a_message_too_long_for_the_bus(tmp_path):
    longer = DBC.replace("BO_ 268 State: 8", "BO_ 268 State: 12")
    with pytest.raises(BadMapError, match="has 12 bytes; longer than 8 needs fd = true"):
        load_can_map(write(tmp_path, dbc=longer))
    path = write(tmp_path, "fd = false", "fd = true", dbc=longer)
    path.write_text(path.read_text()[: path.read_text().rindex("[[frame]]")])
    assert load_can_map(path).fd


def test_a_dbc_that_is_none(tmp_path):
    with pytest.raises(BadMapError, match="cannot be read as DBC"):
        load_can_map(write(tmp_path, dbc="BO_ once upon a time"))


@pytest.fixture
def plan():
    can_map = load_can_map("generic_can")
    return CanPlan(can_map, CanCodec(can_map.dbc), {"i_nom": 30.0, "v_nom": 6.0})


def test_a_tick_is_one_frame(plan):
    (frame,) = plan.outgoing("tick", {"set_current": -2.5, "heartbeat": 7.0, "lock_step": 65537.0})
    assert (frame.message, frame.data) == ("Command", bytes.fromhex("589EFF0701000100"))
    assert plan.echoes(frame, frame.data) is None
    assert plan.echoes(frame, frame.data[:3] + b"\x08" + frame.data[4:]) == (
        "Heartbeat was sent as 7, the device repeats 8"
    )
    assert plan.tolerance_A() == pytest.approx(1e-4, rel=0.1)


def test_settings_without_a_value_are_left_out(plan):
    limits = limit_arguments(plan.map, DeviceLimits((2.5, 4.2), (-5.0, 3.0), (0.0, 50.0), None))
    sent = plan.outgoing("settings", {**limits, "watchdog": 1.0})
    assert len(sent) == 8 and all("lock_step_period" not in frame.arguments for frame in sent)


@pytest.mark.parametrize(("watchdog", "written"), [(0.4, "0"), (1.6, "2"), (1.0, None), (1.4, None)])
def test_a_watchdog_that_is_rounded_to_none_or_to_a_longer_one_is_refused(tmp_path, watchdog, written):
    wattrex = load_can_map("wattrex_epc")
    dbc = wattrex.dbc.read_text().replace(
        "SG_ HeartbeatPeriod : 1|15@1+ (0.001,0)", "SG_ HeartbeatPeriod : 1|15@1+ (1,0)"
    )
    (tmp_path / "whole.dbc").write_text(dbc)
    plan = CanPlan(wattrex, CanCodec(tmp_path / "whole.dbc", wattrex.views), {})
    send = wattrex.commands["watchdog"].send
    if written is None:
        assert plan.frame(send, {"watchdog": watchdog})
        return
    with pytest.raises(SetPointRefusedError, match=f"a watchdog of {watchdog:g} would be written as {written},"):
        plan.frame(send, {"watchdog": watchdog})


@pytest.mark.parametrize("current_A", [float("nan"), float("inf"), 30.1, -30.1])
def test_impossible_set_points(plan, current_A):
    with pytest.raises(SetPointRefusedError, match="not sent"):
        plan.check_current(current_A)


def test_a_short_counter_is_unrolled(plan):
    plan._counter = 256
    raws = {"State": {"Sequence": 3.0}}
    assert plan._sequence(raws, 254) == 259
    assert plan._sequence(raws, 259) == 259
    assert plan._sequence(raws, 2**32 - 1) == 3


def test_each_direction_has_its_magnitude():
    assert with_directions({"set_current": -2.0}) == {
        "set_current": -2.0, "charge": 0.0, "discharge": 2.0, "direction": 1.0,
    }  # fmt: skip
    assert with_directions({"output": 1.0}) == {"output": 1.0}


def test_flags():
    name = SignalName("A", "b")
    assert Flag(name).is_set(2) and not Flag(name).is_set(0)
    assert Flag(name, bit=2).is_set(0b101) and not Flag(name, bit=1).is_set(0b101) and Flag(name, bit=15).is_set(-1)
    assert Flag(name, frozenset((0,))).is_set(0) and not Flag(name, frozenset((0,))).is_set(1)


@pytest.mark.parametrize(
    ("old", "new", "key", "reason"),
    [
        ('signal = "Voltage.Value"', 'signal = "Answer.Value"', "role.actual_voltage", r"multiplexed; name a \[view\]"),
        ('signal = "Voltage.Value"', 'signal = "Voltage.Status"', "role.actual_voltage", "does not have"),
        ("where = { Register = 507 }", "where = { Value = 507 }", "view.Voltage.where.Value", "no such signal"),
        ("where = { Register = 507 }", "where = { Register = 504 }", "role.actual_voltage", "does not have"),
        ("equals = [58, 66, 83]", "equals = []", "identity.equals", "a list of numbers"),
        ("equals = [58, 66, 83]", 'equals = ["node"]', "identity.equals", "a list of numbers"),
        ("execution_s = 0.05", "execution_s = -1", "execution_s", "negative"),
    ],
)
def test_a_multiplexed_message_is_read_through_views_that_say_what_is_in_it(tmp_path, old, new, key, reason):
    text = (MAPS / "ea_psb_can.toml").read_text()
    assert text.count(old) == 1
    (tmp_path / "ea_psb_can.dbc").write_text((MAPS / "ea_psb_can.dbc").read_text())
    path = tmp_path / "changed.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(BadMapError, match=reason) as caught:
        load_can_map(path)
    assert key in caught.value.key, str(caught.value)
