"""What a CAN bus does: error frames, bus-off, foreign senders and nodes, garbage, a lost adapter."""

import asyncio
import contextlib
import itertools
import socket
import time
import uuid

import can
import pytest

from drivers.address import parse_address
from drivers.can_bus import CanReceiver, bus_arguments
from drivers.can_codec import CanCodec
from drivers.can_cycler import CanCycler
from drivers.can_identifiers import identifiers_of
from drivers.can_link import CanLink
from drivers.cycler import (
    BadMapError,
    CyclerConnectionError,
    CyclerProtocolError,
    CyclerTimeoutError,
)
from drivers.factory import open_cycler
from drivers.register_map import load_can_map
from simulators.can_bus import CanAction
from tests.patience import holds
from tests.protocol.can_hooks import on
from tests.protocol.rigs import LIMITS, PATIENT_S, PERIOD_S, TIMEOUT_S, rig

MAP = load_can_map("generic_can")

SETPOINT = "Command"


def joined(made):
    """Another node on the same bus."""
    address = parse_address(made.address)
    return can.Bus(**bus_arguments(address, False))


@pytest.mark.parametrize("transport", ["can-virtual", "can-udp"])
async def test_bus_off_ends_the_wait_at_once(transport):
    async with rig(transport) as made:
        await made.running()
        made.server.on_frame = on("Request", CanAction(bus_off=True))
        started_s = time.monotonic()
        with pytest.raises(CyclerConnectionError, match="bus-off: check wiring"):
            await made.driver.sample()
        assert time.monotonic() - started_s < PATIENT_S / 2
        await made.driver.safe()
        assert made.at_rest


async def test_other_error_frames_are_counted(made):
    await made.running()
    with joined(made) as bus:
        bus.send(can.Message(arbitration_id=0x08, is_error_frame=True, is_extended_id=False, data=bytes(8)))
        await holds(lambda: made.driver._link.error_frames, "the error frame is heard")
        assert (await made.driver.sample()).output_on
    assert made.driver._link.error_frames == 1
    made.server.on_frame = on("Request", CanAction(execute=False))
    with made.impatient(), pytest.raises(CyclerTimeoutError, match="1 error frames"):
        await made.driver.sample()


async def test_own_frames_that_come_back_are_no_answer(udp):
    """Multicast returns what was sent; taken for the device's, it would confirm everything."""
    assert (await udp.running()).output_on
    assert udp.driver._link.error_frames == 0
    udp.server.on_frame = on("Command", CanAction(execute=False))
    with udp.impatient(), pytest.raises(CyclerTimeoutError, match="'CommandEcho'"):
        await udp.driver.apply(1.0)


@pytest.mark.parametrize("transport", ["can-virtual", "can-udp"])
async def test_a_second_master_is_noticed(transport):
    async with rig(transport) as made:
        await made.running()
        with joined(made) as bus:
            data = CanCodec(MAP.dbc).encode(SETPOINT, {"SetCurrent": 9.0, "Heartbeat": 1, "Tick": 1})
            bus.send(can.Message(arbitration_id=0x100, data=data, is_extended_id=False))
            await holds(lambda: made.driver._link._inbox.foreign, "the other sender is heard")
        with pytest.raises(CyclerProtocolError, match="another sender uses identifier 0x100"):
            await made.driver.sample()
        await made.driver.safe()
        assert made.at_rest
        # It is at rest, and yet not alone.
        with pytest.raises(CyclerProtocolError, match="another sender uses identifier 0x100"):
            await made.driver.sample()
        # Coming back forgets what was seen, as identifying the device begins anew.
        await made.driver.close()
        await made.driver.connect()
        assert not (await made.driver.sample()).output_on


@contextlib.asynccontextmanager
async def a_second_master(made):
    """Another sender that steers the device too, and goes on."""
    codec, heartbeats = CanCodec(MAP.dbc), itertools.cycle(range(256))
    with joined(made) as bus:

        async def steer():
            while True:
                values = {"SetCurrent": 9.0, "Heartbeat": next(heartbeats), "Tick": 1}
                data = codec.encode(SETPOINT, values)
                bus.send(can.Message(arbitration_id=0x100, data=data, is_extended_id=False))
                await asyncio.sleep(0.002)

        task = asyncio.create_task(steer())
        yield
        task.cancel()


@pytest.mark.parametrize("transport", ["can-virtual", "can-udp"])
async def test_beside_a_second_master_rest_is_commanded_by_who_has_just_come(transport):
    async with rig(transport) as made:
        await made.running()
        await made.driver.close()
        async with a_second_master(made):
            newcomer = made.another()
            await newcomer.connect()
            await holds(lambda: newcomer._link._inbox.foreign, "the other sender is heard")
            assert made.device.cycler.output_on
            await newcomer.safe()
            assert not made.device.cycler.output_on
            for call in (newcomer.sample, lambda: newcomer.acquire(LIMITS, 1.0, PERIOD_S)):
                with pytest.raises(CyclerProtocolError, match="another sender uses identifier 0x100"):
                    await call()
            await newcomer.close()
            # Who is told to rest before it has connected finds its own way there.
            made.device.cycler.set_output(True)
            await made.driver.safe()
            assert not made.device.cycler.output_on


async def test_foreign_traffic_is_passed_over(made):
    await made.running()
    with joined(made) as bus:
        for message in (
            can.Message(arbitration_id=0x7FF, data=b"12345678", is_extended_id=False),
            can.Message(arbitration_id=0x10A, data=bytes(8), is_extended_id=True),
            can.Message(arbitration_id=0x10A, is_remote_frame=True, dlc=8, is_extended_id=False),
        ):
            bus.send(message)
        await asyncio.sleep(0.1)
    assert (await made.driver.sample()).voltage_V > 3.0


async def test_garbage_in_the_group_is_passed_over(udp):
    await udp.running()
    address = parse_address(udp.address)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        for data in (b"", b"\x00", b"no frame at all", bytes(2000)):
            sender.sendto(data, (address.channel, address.port))
    await asyncio.sleep(0.1)
    assert (await udp.driver.sample()).output_on


def test_nothing_leaves_the_machine():
    address = parse_address("can://udp_multicast/239.74.163.2:43113")
    assert bus_arguments(address, False)["hop_limit"] == 0
    with can.Bus(**bus_arguments(address, False)) as bus:
        sender = bus._multicast._socket
        assert sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0


async def test_two_nodes_on_one_bus():
    async with rig("can-virtual") as first:
        from simulators.bench import SimulatorSettings, build_can_device
        from simulators.can_bus import CanBusSettings
        from simulators.can_node import CanNode

        device = build_can_device(SimulatorSettings(map_name="generic_can", lock_step=True, initial_soc=0.8))
        node = CanNode(device, CanBusSettings(interface="virtual", channel=first.server.settings.channel, node=3))
        address = await node.start()
        other = open_cycler(address, "generic_can", PATIENT_S)
        await first.running(2.0)
        await other.connect()
        await other.acquire(LIMITS, 1.0, 0.1)
        await other.output(True)
        await other.sample()
        await other.apply(-3.0)
        seen = await first.driver.sample(), await other.sample()
        assert [reading.setpoint_in_force_A for reading in seen] == [2.0, -3.0]
        assert seen[1].voltage_V > seen[0].voltage_V - 0.2
        await other.safe()
        assert not device.cycler.output_on and first.device.cycler.output_on
        await other.close()
        await node.close()


async def test_a_node_number_that_does_not_fit():
    with pytest.raises(CyclerConnectionError, match="needs identifier 0xD8C; too large"):
        open_cycler("can://virtual/x?node=200", "generic_can", TIMEOUT_S)


async def test_map_and_address_must_be_of_one_transport():
    with pytest.raises(BadMapError, match="is 'modbus', but the address can://virtual/x wants 'can'"):
        open_cycler("can://virtual/x", "generic", TIMEOUT_S)
    with pytest.raises(BadMapError, match="is 'can', but the address"):
        open_cycler("modbus-tcp://h:1", "generic_can", TIMEOUT_S)


async def test_a_bus_that_is_not_there():
    driver = open_cycler("can://socketcan/there-is-none", "generic_can", TIMEOUT_S)
    with pytest.raises(CyclerConnectionError, match="cannot join the bus"):
        await driver.connect()


async def test_nobody_on_the_bus():
    driver = open_cycler(f"can://virtual/{uuid.uuid4().hex}", "generic_can", TIMEOUT_S)
    for call in (driver.connect, driver.safe):
        with pytest.raises(CyclerTimeoutError, match="no answer 'Info'"):
            await call()
    await driver.close()


class StuckBus:
    """A bus that takes no frame."""

    def __init__(self, bus):
        self._bus = bus

    def send(self, *_, **__):
        raise can.CanOperationError("Transmit buffer full")

    def shutdown(self):
        self._bus.shutdown()


async def test_a_frame_that_cannot_be_sent(made):
    await made.running()
    link = made.driver._link
    link._bus = StuckBus(link._bus)
    with pytest.raises(CyclerConnectionError, match="cannot send: Transmit buffer full"):
        await made.driver.apply(1.0)
    await made.driver.safe()
    assert made.at_rest


class LostBus(StuckBus):
    def recv(self, _):
        raise can.CanOperationError("adapter unplugged")

    def fileno(self):
        raise NotImplementedError


async def test_an_adapter_that_is_pulled_out(made):
    await made.running()
    link = made.driver._link
    told = []
    receiver = CanReceiver(LostBus(link._bus), told.append, link._inbox.failed, lenient=False)
    await holds(lambda: not link.is_open, "the link is given up")
    receiver.close()
    assert not told
    with pytest.raises(CyclerConnectionError, match="the bus is lost: adapter unplugged"):
        await made.driver.sample()


async def test_a_link_can_be_built_by_hand():
    codec = CanCodec(MAP.dbc)
    address = parse_address("can://virtual/alone")
    link = CanLink(
        address,
        identifiers_of(address, codec.identifiers({"Request"}), codec.identifiers({"Info"}), 16),
        fd=False,
        min_gap_s=0.01,
        timeout_s=0.05,
        silence_s=0.1,
    )
    assert isinstance(CanCycler(link, MAP, codec), CanCycler)
    await link.open()
    with pytest.raises(CyclerTimeoutError):
        await link.exchange("Request", b"\x01\x01", ("Info",), "asking")
    started_s = time.monotonic()
    await link.open()
    assert time.monotonic() - started_s >= 0.09, "silence after a time-out"
    await link.exchange("Request", b"\x01\x01", (), "telling")
    started_s = time.monotonic()
    await link.exchange("Request", b"\x01\x02", (), "telling")
    assert time.monotonic() - started_s >= 0.009, "the gap between two frames"
    link.close()
