"""How each interface is joined."""

import can
import pytest

from drivers.address import parse_address
from drivers.can_bus import bus_arguments


@pytest.mark.parametrize("fd", [False, True])
def test_traffic_by_udp_never_leaves_the_machine(fd):
    told = bus_arguments(parse_address("can://udp_multicast/239.74.163.2:43113"), fd)
    assert told == {
        "interface": "udp_multicast", "channel": "239.74.163.2", "port": 43113, "hop_limit": 0, "fd": fd,
    }  # fmt: skip


def test_a_virtual_bus_says_which_protocol_it_has():
    address = parse_address("can://virtual/x")
    assert bus_arguments(address, False)["protocol"] is can.CanProtocol.CAN_20
    assert bus_arguments(address, True)["protocol"] is can.CanProtocol.CAN_FD


def test_an_adapter_is_told_the_bit_rates_and_socketcan_is_not():
    adapter = parse_address("can://pcan/PCAN_USBBUS1?bitrate=250000&dbitrate=2000000")
    common = {"interface": "pcan", "channel": "PCAN_USBBUS1", "bitrate": 250_000}
    assert bus_arguments(adapter, False) == common
    assert bus_arguments(adapter, True) == common | {"fd": True, "data_bitrate": 2_000_000}
    system = parse_address("can://socketcan/can0?bitrate=250000")
    assert bus_arguments(system, True) == {"interface": "socketcan", "channel": "can0", "fd": True}
