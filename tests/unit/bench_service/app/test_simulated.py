import pytest

from bench_service.app.simulated import same_address


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
