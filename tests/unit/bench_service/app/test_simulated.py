from dataclasses import replace

import pytest

from bench_service.app.simulated import same_address, simulator_arguments
from bench_service.bench.limits import Limits
from bench_service.bench.protocol_window import window_of
from bench_service.campaign.chambers import chamber_settings, chamber_window
from bench_service.config import ConfigError, parse_config


@pytest.mark.parametrize(
    ("address", "arguments"),
    [
        ("modbus-tcp://127.0.0.1:1502", ["--host", "127.0.0.1", "--port", "1502"]),
        ("modbus-rtu:///run/bench-x/line?baud=115200", ["--device", "/run/bench-x/line"]),
        ("can://udp_multicast/239.74.163.2:43113?node=0", ["--channel", "udp_multicast/239.74.163.2:43113"]),
    ],
)
def test_a_simulator_that_is_started_again_listens_where_the_one_before_did(address: str, arguments: list[str]) -> None:
    assert same_address(address) == arguments


def test_a_simulated_module_has_its_cells_limits_times_its_cells() -> None:
    config = parse_config("[bench.a]\nsimulate = {cell = 'lfp', module = '4x2'}").bench["a"]
    assert config.limits.voltage_V == pytest.approx((8.0, 14.6)) and config.capacity_Ah == 5.0
    assert config.limits.current_A == pytest.approx((-50.0, 20.0))
    assert config.simulate is not None
    arguments = simulator_arguments(config.simulate, "generic")
    assert arguments[arguments.index("--module") + 1] == "4x2"
    for wrong in ("4", "0x2", "4x", "4x2x1", "x"):
        with pytest.raises(ConfigError, match=r"bench\.a\.simulate\.module"):
            parse_config(f"[bench.a]\nsimulate = {{module = '{wrong}'}}")


def test_a_simulated_chamber_is_started_beside_the_cycler_and_a_real_one_is_not() -> None:
    table = "[bench.a]\nsimulate = {lock_step = false}\n[bench.a.chamber]\n"
    config = parse_config(table + "simulate = {ramp_K_per_min = 5, faults = 'drop@t:9'}").bench["a"]
    assert config.simulate is not None
    arguments = simulator_arguments(config.simulate, config.map, config.chamber)
    at = arguments.index("--chamber")
    expected = ["generic_chamber", "--chamber-ramp", "5.0", "--chamber-faults", "drop@t:9"]
    assert arguments[at + 1 : at + 6] == expected
    settings = chamber_settings(config, "modbus-tcp://127.0.0.1:9")
    assert settings is not None and settings.url == "modbus-tcp://127.0.0.1:9"
    assert settings.temperature_degC == config.limits.temperature_degC and settings.at_end == "off"
    real = parse_config(table + "url = 'modbus-tcp://h:1'\ntemperature_degC = [10, 40]\ntolerance_K = 0.3").bench["a"]
    assert real.simulate is not None
    assert "--chamber" not in simulator_arguments(real.simulate, real.map, real.chamber)
    found = chamber_settings(real, None)
    assert found is not None and (found.url, found.temperature_degC) == ("modbus-tcp://h:1", (10.0, 40.0))
    assert chamber_window(real) == found.window
    narrow = replace(Limits.from_json(real.limits.model_dump()), temperature_degC=(20.0, 60.0))
    narrowed = window_of(narrow, chamber=found.window).chamber
    assert narrowed is not None and (narrowed.temperature_degC, narrowed.tolerance_K) == ((20.0, 40.0), 0.3)
    none = parse_config("[bench.a]\nsimulate = {}").bench["a"]
    assert chamber_settings(none, None) is None and chamber_window(none) is None
