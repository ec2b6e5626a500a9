"""From settings to what stands behind a protocol."""

import math

import pytest

from simulators.bench import SimulatorSettings, build_can_device, build_device
from simulators.clocks import LockStepClock, WallClock
from simulators.cycler import CyclerSettings
from simulators.module import ModuleLayout


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"protocol": "gpib"}, "unknown protocol 'gpib'; choose one of modbus-tcp, modbus-rtu, can"),
        ({"speed": 0.0}, "speed is 0.0"),
        ({"speed": 2e5}, "at most 100000"),
        ({"devices": 0}, "0 devices; it must be 1..64"),
        ({"port": 70000}, "port is 70000"),
    ],
)
def test_impossible_settings_are_told(settings, reason):
    with pytest.raises(ValueError, match=reason):
        SimulatorSettings(**settings)


def test_a_device_has_the_rating_of_its_map_unless_it_is_told_one():
    rated = build_device(SimulatorSettings(map_name="riden_rd6006")).cycler.settings
    assert (rated.nominal_current_A, rated.nominal_voltage_V) == (6.0, 60.0)
    assert rated.watchdog_s == math.inf, "the map has no watchdog"
    own = CyclerSettings(nominal_current_A=9.0)
    assert build_device(SimulatorSettings(map_name="riden_rd6006", cycler=own)).cycler.settings.nominal_current_A == 9.0
    generic = build_device(SimulatorSettings()).cycler.settings
    assert generic == CyclerSettings(), "its map reads the rating from the device"


def test_the_rating_counts_per_cell_of_a_module():
    layout = ModuleLayout(cells_in_series=3, cells_in_parallel=2)
    rated = build_device(SimulatorSettings(module=layout)).cycler.settings
    assert (rated.nominal_voltage_V, rated.nominal_current_A) == (18.0, 60.0)
    assert rated.constants == {"i_nom": 60.0, "v_nom": 18.0, "p_nom": 1080.0}


def test_the_clock_and_the_way_to_say_no_follow_from_the_settings():
    assert isinstance(build_device(SimulatorSettings()).clock, WallClock)
    assert isinstance(build_device(SimulatorSettings(lock_step=True)).clock, LockStepClock)
    made = build_can_device(SimulatorSettings(protocol="can", map_name="ea_psb_can"))
    made.cycler.set_remote(False)
    assert made.commands.execute("output", {"output": 1.0}) == 7, "access denied, as an EA PSB says it"
