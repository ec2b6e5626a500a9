import re
from dataclasses import FrozenInstanceError, replace

import pytest

from drivers.register_map import MAPS, BadMapError, Block, list_maps, load_map, plan_reads

GENERIC = (MAPS / "generic.toml").read_text()


def write(tmp_path, *changes):
    """Write the generic map with some text exchanged."""
    text = GENERIC
    for old, new in changes:
        assert text.count(old) >= 1, old
        text = text.replace(old, new, 1)
    path = tmp_path / "changed.toml"
    path.write_text(text)
    return path


def test_the_map_that_comes_with_the_program():
    assert "generic" in list_maps()
    device_map = load_map("generic")
    assert device_map.by_role("set_current") is device_map.registers["set_current"]
    assert device_map.coil_by_role("output") is device_map.coils["output"]
    assert device_map.by_role("nonesuch") is None
    with pytest.raises(FrozenInstanceError):
        device_map.unit_id = 2
    with pytest.raises(TypeError):
        device_map.registers["x"] = device_map.registers["status"]


def test_a_map_can_be_a_file_of_any_place(tmp_path):
    assert load_map(write(tmp_path)).name == "generic"
    assert load_map(str(write(tmp_path))).name == "generic"


STATUS = '[reg.status]\naddress = 210\ntype = "u16"'
CURRENT_RANGE = 'range = ["-i_nom", "i_nom"]'


@pytest.mark.parametrize(
    ("old", "new", "key", "reason"),
    [
        ("schema = 1", "schema = 2", "schema", "reads schema 1"),
        ("schema = 1", 'schema = "1"', "schema", "must be a whole number, not '1'"),
        ("unit_id = 1", "unit_id = true", "unit_id", "must be a whole number, not True"),
        ("unit_id = 1", "unit_id = 256", "unit_id", "within 0 and 255"),
        ("unit_id = 1", "", "unit_id", "is missing"),
        ("unit_id = 1", "unit_id = 1\nbaud = 9600", "baud", "not a known key"),
        ("min_gap_s = 0.0", "min_gap_s = nan", "min_gap_s", "must be a number"),
        ("min_gap_s = 0.0", "min_gap_s = -1", "min_gap_s", "not be negative"),
        ('transport = "modbus"', 'transport = "smoke"', "transport", "must be one of modbus"),
        ('word_order = "big"', 'word_order = "bug"', "word_order", "big, little"),
        ("functions = [1, 3, 5", "functions = [1, 3, 99, 5", "functions", r"\[99\] are not supported"),
        ("functions = [1, 3, 5, 6", "functions = [1, 5, 6", "reg.device_class.access", "lacks 3"),
        ("5, 6, 15, 16, 23]", "5, 6, 15, 23]", "reg.set_current.access", "lacks 16"),
        ("1, 3, 5, 6, 15, 16", "1, 3, 6, 16", "coil.remote.access", "lacks 5 or 15"),
        ('type = "u16"', 'type = "u17"', "reg.device_class.type", "'u17'"),
        (STATUS, '[reg.status]\naddress = 209\ntype = "u16"', "reg.status.address", "overlaps 'setpoint_in_force'"),
        (STATUS, '[reg.status]\naddress = 212\ntype = "u16"', "reg.status.address", "does not lie in one"),
        (STATUS, '[reg.status]\naddress = 65536\ntype = "u16"', "reg.status.address", "within 0 and 65535"),
        ("first = 110", "first = 105", "block", "105..135 overlaps 100..105"),
        ("first = 110", "first = 140", r"block\[2\].last", "within 140"),
        ('role = "status"', 'role = "state"', "reg.status.role", "not 'state'"),
        ('role = "alarms"', 'role = "status"', "reg", "role 'status' is given to 2"),
        ('role = "status"', "", "reg", "no register has the role 'status'"),
        ('access = "rw"\nrole = "set_current"', 'access = "r"\nrole = "set_current"', "reg.set_current.access", "'w'"),
        ('access = "rw"\nrole = "watchdog"', 'access = "w"\nrole = "watchdog"', "reg.watchdog.access", "read back"),
        ('role = "output"', "", "coil", "role 'output'"),
        ("output_on = 0", "on = 0", "bits", "output_on"),
        ("output_on = 0", "output_on = 16", "bits.status", "bit 16 does not exist in type u16"),
        ("output_on = 0", "output_on = 1", "bits.status", "same bit"),
        ("output_on = 0", 'output_on = "0"', "bits.status.output_on", "bit position"),
        ("[bits.alarms]", "[bits.alarm]", "bits.alarm", "not a register"),
        (CURRENT_RANGE, 'range = ["-i_max", "i_nom"]', r"reg.set_current.range\[0\]", "i_max, which .const. does not"),
        (CURRENT_RANGE, 'range = ["-i_nom"]', "reg.set_current.range", "low and high"),
        (CURRENT_RANGE, 'range = ["-i_nom", "abs(i_nom)"]', r"reg.set_current.range\[1\]", "Call is not allowed"),
        ('scale = "0.001"', 'scale = "1/0"', "reg.watchdog.scale", "divides by zero"),
        ('scale = "0.001"', "scale = [1]", "reg.watchdog.scale", "expression in quotes"),
        ('i_nom = "nominal_current"', 'i_nom = "nominal"', "const.i_nom", "not a register"),
        ('i_nom = "nominal_current"', 'i_nom = "watchdogs"', "const.i_nom", "not a register"),
        ('register = "device_class"', 'register = "klass"', "identity.register", "'klass'"),
        ("equals = 0x4254", "equals = true", "identity.equals", "number or a string"),
        ('"60"]\nverify = "readback"', '"60"]\nverify = "hope"', "reg.watchdog.verify", "'hope'"),
        ("readback:setpoint_in_force", "readback:set_point", "reg.set_current.verify", "'set_point'"),
        ('"readback:setpoint_in_force"', '"echo"', "reg.set_current.verify", "one word"),
        ("invalid = [0x8000]", "invalid = [0x18000]", "reg.temperature.invalid", "within 0 and 65535"),
        ("[coil.remote]\naddress = 0", "[coil.remote]\naddress = 1", "coil.remote.address", "two coils"),
        ("[coil.remote]", "[coil.status]", "coil.status", "same name"),
        ('write = "output", value = false', 'write = "output", value = true', "sequence.safe", "output off"),
        ('write = "output", value = false', 'write = "outptu", value = false', r"sequence.safe\[1\].write", "outptu"),
        (
            'write = "output", value = false',
            'write = "output", value = 0',
            r"sequence.safe\[1\].value",
            "true or false",
        ),
        ('write = "output", value = false', 'write = "output", value = "x"', r"sequence.safe\[1\].value", r"\$NAME"),
        ("[sequence]", "[sequence]\nrest = []", "sequence.rest", "not a known key"),
        ('request = "03 00C8', 'request = "03 0xC8', r"frame\[0\].request", "hexadecimal"),
        ('missing = ["ambient_temperature"]', 'missing = ["ambience"]', r"frame\[0\]", "'ambience'"),
        ('role = "lock_step"  ', 'role = "sequence"  ', "reg", "role 'sequence' is given to 2"),
        ('role = "lock_step_period"', "", "reg", "come together"),
        ('unlimited = 0.0                      # what to write for "hold', '# "', "reg.hold_voltage", "'unlimited'"),
    ],
)
def test_what_is_wrong_is_told_by_file_key_and_reason(tmp_path, old, new, key, reason):
    path = write(tmp_path, (old, new))
    with pytest.raises(BadMapError) as caught:
        load_map(path)
    assert caught.value.file == str(path)
    assert re.fullmatch(key, caught.value.key)
    assert re.search(reason, caught.value.reason)
    assert str(caught.value) == f"{path}: {caught.value.key}: {caught.value.reason}"


def test_a_map_without_a_way_to_rest(tmp_path):
    path = tmp_path / "restless.toml"
    path.write_text(re.sub(r"safe = \[.*?\n\]\n", "", GENERIC, flags=re.DOTALL))
    with pytest.raises(BadMapError, match=r"sequence\.safe: is missing"):
        load_map(path)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(BadMapError, match=r"does not exist; maps that come with the program: .*generic"):
        load_map("psb9000")
    with pytest.raises(BadMapError, match="does not exist$"):
        load_map(tmp_path / "none.toml")
    (tmp_path / "broken.toml").write_text("schema = = 1")
    with pytest.raises(BadMapError, match=r"broken\.toml: \(file\): is not TOML"):
        load_map(tmp_path / "broken.toml")
    (tmp_path / "latin.toml").write_bytes(b'title = "\xe4"')
    with pytest.raises(BadMapError, match="cannot be read"):
        load_map(tmp_path / "latin.toml")


def planned(device_map, *names):
    return [(plan.first, plan.count) for plan in plan_reads(device_map, names)]


def test_a_sample_is_one_read():
    device_map = load_map("generic")
    assert planned(device_map, "alarms", "sequence", "actual_voltage") == [(200, 12)]


def test_reads_do_not_cross_blocks_or_gaps(tmp_path):
    device_map = load_map("generic")
    assert planned(device_map, "serial", "set_current") == [(6, 2), (100, 2)]
    # 114..119 lie in the block of 110..134, but belong to no register
    assert planned(device_map, "watchdog", "ramp") == [(110, 1), (132, 2)]
    assert planned(device_map, "watchdog", "lock_step_period") == [(110, 4)]
    heartbeat = ('type = "u16"\naccess = "rw"\nrole = "heartbeat"', 'type = "u16"\naccess = "w"')
    not_read = ('verify = "readback"                  # another value', "# another value")
    write_only = load_map(write(tmp_path, heartbeat, not_read))
    assert planned(write_only, "set_current", "lock_step") == [(100, 2), (103, 2)]


def test_reads_keep_to_the_largest_count_and_cut_no_register():
    small = replace(load_map("generic"), max_read_registers=5)
    assert planned(small, "sequence", "actual_voltage", "actual_current") == [(200, 4), (204, 2)]


def test_reads_of_one_type():
    device_map = load_map("generic")
    strict = replace(device_map, blocks=(Block("holding", 0, 300, one_type=True),))
    names = ("sequence", "actual_voltage", "actual_current", "temperature", "ambient_temperature")
    assert planned(strict, *names) == [(200, 2), (202, 4), (206, 2)]


def test_without_blocks_each_register_is_read_alone():
    device_map = replace(load_map("generic"), blocks=())
    assert planned(device_map, "actual_voltage", "actual_current") == [(202, 2), (204, 2)]
