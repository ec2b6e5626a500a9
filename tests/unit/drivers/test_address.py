"""Addresses of cyclers: each form, its options, and what is refused."""

import pytest

from drivers.address import CanAddress, SerialAddress, TcpAddress, parse_address
from drivers.errors import CyclerConnectionError


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("modbus-tcp://cycler.lab", TcpAddress("cycler.lab", 502)),
        ("modbus-tcp://[::1]:1502?unit=3", TcpAddress("::1", 1502, unit=3)),
        ("modbus-rtu:///dev/ttyS0", SerialAddress("/dev/ttyS0")),
        (
            "modbus-rtu:///dev/pts/4?baud=115200&parity=E&stopbits=2&unit=7&rs485=1&echo=1",
            SerialAddress("/dev/pts/4", 115200, "E", 2, 7, rs485=True, echo=True),
        ),
        ("can://socketcan/can0", CanAddress("socketcan", "can0")),
        (
            "can://udp_multicast/239.74.163.2:43113?node=2&log=traffic",
            CanAddress("udp_multicast", "239.74.163.2", port=43113, node=2, log="traffic"),
        ),
        (
            "can://socketcan/can1?bitrate=250000&dbitrate=2000000",
            CanAddress("socketcan", "can1", 250_000, 2_000_000),
        ),
    ],
)
def test_what_is_understood(url, address):
    assert parse_address(url) == address


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("/dev/ttyS0", "the address of a cycler is"),
        ("modbus-rtu://dev/ttyS0", "the address of a cycler is"),
        ("modbus-rtu:///", "the address of a cycler is"),
        ("modbus-tcp://user@h:1", "the address of a cycler is"),
        ("can://can0", "the address of a cycler is"),
        ("modbus-rtu:///dev/ttyS0?baud=quick", "baud is 'quick'; it must be a whole number within 300 and"),
        ("modbus-rtu:///dev/ttyS0?parity=M", "parity is 'M'; it must be one of N, E, O"),
        ("modbus-rtu:///dev/ttyS0?speed=9600", "unknown option 'speed'"),
        ("modbus-tcp://h:1?unit=256", "unit is '256'"),
        ("modbus-tcp://h:1?unit", "bad query"),
        ("can://tokencan/can0", "interface 'tokencan' is not one of"),
        ("can://udp_multicast/239.74.163.2", "needs a channel GROUP:PORT"),
    ],
)
def test_what_is_refused(url, reason):
    with pytest.raises(CyclerConnectionError, match=reason):
        parse_address(url)


def test_shown_addresses_can_be_understood_again():
    for url in ("modbus-tcp://[::1]:502", "modbus-rtu:///dev/ttyS0?baud=9600", "can://virtual/lab?node=1"):
        assert str(parse_address(url)) == url
    assert str(parse_address("can://udp_multicast/239.74.163.2:43113")).startswith("can://udp_multicast/239.74.163.2:")


def test_a_character_takes_its_bits():
    assert SerialAddress("/dev/x", 9600).character_s == pytest.approx(10 / 9600)
    assert SerialAddress("/dev/x", 9600, "E", 1).character_s == pytest.approx(11 / 9600)
