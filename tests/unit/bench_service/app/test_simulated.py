import pytest

from bench_service.app.simulated import same_address, simulator_arguments
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
