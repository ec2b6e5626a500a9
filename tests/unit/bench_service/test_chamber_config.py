"""The table of a bench's temperature chamber."""

import pytest

from bench_service.config import ChamberConfig, ConfigError, SimulatedChamberConfig, example_config, parse_config

SIMULATED = "[bench.a]\nsimulate = {lock_step = false}\n"
REAL = (
    "[bench.a]\nurl = 'modbus-tcp://h:1'\ncapacity_Ah = 2\n"
    "limits = { voltage_V = [2.5, 4.2], current_A = [-5, 5], temperature_degC = [0, 45] }\n"
)


def test_a_simulated_bench_has_a_simulated_one_within_its_limits() -> None:
    bench = parse_config("[bench.a]\nsimulate = {}\n[bench.a.chamber]\n").bench["a"]
    assert bench.chamber == ChamberConfig() and bench.chamber_degC == bench.limits.temperature_degC
    assert parse_config("[bench.a]\nsimulate = {}").bench["a"].chamber_degC is None


def test_a_real_one_has_an_address_and_a_window() -> None:
    table = "[bench.a.chamber]\nurl = 'modbus-tcp://10.0.0.9:502'\ntemperature_degC = [10, 40]\nat_end = 25\n"
    for bench in (REAL, SIMULATED):
        read = parse_config(bench + table).bench["a"]
        assert read.chamber is not None and read.chamber.at_end == 25.0 and read.chamber_degC == (10.0, 40.0)


@pytest.mark.parametrize(
    ("bench", "chamber", "message"),
    [
        (SIMULATED, "colour = 'red'", "bench.a.chamber.colour: unknown key"),
        (SIMULATED, "temperature_degC = [40, 10]", "low 40 must be below high 10"),
        (SIMULATED, "temperature_degC = [0, 70]", "0 to 70 degC leaves limits.temperature_degC -20 to 60 degC"),
        (SIMULATED, "at_end = 'cold'", 'must be "off", "keep" or a temperature'),
        (SIMULATED, "at_end = 99", "chamber.at_end 99 degC is outside -20 to 60 degC"),
        (SIMULATED, "lost_s = 0", "bench.a.chamber.lost_s"),
        (SIMULATED, "url = 'modbus-tcp://h:1'\nsimulate = {}", "give either 'url'"),
        (SIMULATED, "url = 'can://socketcan/can0'", "reached over modbus-tcp or modbus-rtu"),
        (SIMULATED, "url = 'http://h'", "the address of a cycler is"),
        (SIMULATED, "simulate = {ramp_K_per_min = 0}", "bench.a.chamber.simulate.ramp_K_per_min"),
        ("[bench.a]\nsimulate = {}\n", "url = 'modbus-tcp://h:1'", "has no lock-step"),
        (REAL, "", "a real cell needs a real chamber"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(bench: str, chamber: str, message: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        parse_config(f"{bench}[bench.a.chamber]\n{chamber}\n", "b.toml")
    assert message in str(refusal.value) and "\n" not in str(refusal.value)


def test_the_example_explains_every_key() -> None:
    lines = example_config().splitlines()
    begin = lines.index("# [bench.sim.chamber]")
    end = lines.index("", begin)
    keys = {line.split("=")[0].strip("# ") for line in lines[begin:end] if "=" in line}
    assert set(ChamberConfig.model_fields) <= keys
    assert all(name in "\n".join(lines[begin:end]) for name in SimulatedChamberConfig.model_fields)
    # What stands there is the default, but for address and window.
    told = [line.removeprefix("# ") for line in lines[begin + 1 : end] if " = " in line]
    values = [line for line in told if not line.startswith(("url", "temperature_degC"))]
    read = parse_config("[bench.a]\nsimulate = {}\n[bench.a.chamber]\n" + "\n".join(values)).bench["a"].chamber
    assert read == ChamberConfig(simulate=SimulatedChamberConfig())
