"""What only CAN has: tokens, echoes, foreign senders, error frames, bus-off, garbage, and the log of the traffic."""

import asyncio
import socket
import subprocess
import sys
import time
import uuid

import can
import cantools
import pytest

from drivers.address import parse_address
from drivers.can_codec import CanCodec
from drivers.can_cycler import CanCycler
from drivers.can_link import CanLink, _bus_arguments
from drivers.cycler import (
    BadMapError,
    CyclerConnectionError,
    CyclerProtocolError,
    CyclerTimeoutError,
    SetPointRefusedError,
)
from drivers.factory import open_cycler
from drivers.register_map import load_can_map
from simulators.can_bus import CanAction
from tests.protocol.rigs import LIMITS, TIMEOUT_S, rig

MAP = load_can_map("generic_can")
VOLTAGE, SETPOINT = "Electrical", "Command"


@pytest.fixture
async def made():
    async with rig("can-virtual") as found:
        yield found


@pytest.fixture
async def udp():
    async with rig("can-udp") as found:
        yield found


def on(message, action, *, item=None, times=1):
    """Fault hook for the next frames of one name."""
    left = [times]

    def hook(name, raws):
        if name != message or left[0] == 0 or (item is not None and raws["Item"] != item):
            return None
        left[0] -= 1
        return action

    return hook


def joined(made):
    """Another node on the same bus."""
    address = parse_address(made.address)
    return can.Bus(**_bus_arguments(address, False))


async def test_silence_is_a_time_out_and_ends_in_rest(made):
    await made.running()
    made.server.on_frame = on("Request", CanAction(execute=False))
    started_s = time.monotonic()
    with pytest.raises(CyclerTimeoutError, match=r"no answer 'Condition', 'Electrical', 'State' within 0\.25 s"):
        await made.driver.sample()
    assert time.monotonic() - started_s < TIMEOUT_S + 0.2
    with pytest.raises(CyclerConnectionError, match="not connected"):
        await made.driver.sample()
    await made.driver.safe()
    assert made.at_rest
    with pytest.raises(CyclerProtocolError, match="acquire first"):  # reconnecting never resumes
        await made.driver.apply(1.0)


async def test_one_frame_of_an_answer_lost(made):
    await made.running()
    made.server.on_frame = on("Request", CanAction(change=lambda name, data: None if name == "State" else data))
    with pytest.raises(CyclerTimeoutError, match="no answer 'State' within"):
        await made.driver.sample()


async def test_a_late_answer_is_known_by_its_token(made):
    await made.running()
    link = made.driver._link
    codec, plan = CanCodec(MAP.dbc), made.driver._plan
    first = plan.frame(MAP.asks["sample"].send, {"token": 200.0})
    made.server.on_frame = on("Request", CanAction(delay_s=0.1))
    await link.exchange("Request", first, (), "a question whose answer nobody waits for")
    await asyncio.sleep(0.03)
    voltage = made.device.cycler.measurement.voltage_V
    made.device.cycler.measurement = made.device.cycler.measurement._replace(voltage_V=1.0)
    reading = await made.driver.sample()
    await asyncio.sleep(0.15)  # now the late answer, with the old voltage, is in
    assert reading.voltage_V == 1.0 and link.newest[VOLTAGE][0] > reading.monotonic_s
    assert codec.physical(VOLTAGE, codec.raw(VOLTAGE, link.newest[VOLTAGE][1]))["Voltage"] == pytest.approx(voltage)
    assert (await made.driver.sample()).voltage_V == 1.0


async def test_an_echo_that_differs(made):
    await made.running()
    made.server.on_frame = on(SETPOINT, CanAction(change=lambda _, data: bytes(3) + data[3:]))
    with pytest.raises(SetPointRefusedError, match=r"'setpoint': SetCurrent was sent as 3, the device repeats 0"):
        await made.driver.apply(3.0)


async def test_a_refusal_is_told_with_its_reason(made):
    await made.running()
    with pytest.raises(SetPointRefusedError, match=r"refused with code 3 \(value out of range\)"):
        await made.driver.apply(11.0)  # beyond the limit in the device


async def test_answers_under_another_identifier_are_not_heard(made):
    await made.running()
    made.server.on_frame = on("Request", CanAction(shift=0x200))
    with pytest.raises(CyclerTimeoutError):
        await made.driver.sample()


async def test_a_frame_that_is_too_short(made):
    await made.running()
    made.server.on_frame = on("Request", CanAction(change=lambda name, data: data[:3] if name == "State" else data))
    with pytest.raises((CyclerProtocolError, CyclerTimeoutError)):
        await made.driver.sample()
    await made.driver.safe()
    assert made.at_rest


@pytest.mark.parametrize("transport", ["can-virtual", "can-udp"])
async def test_bus_off_ends_the_wait_at_once(transport):
    async with rig(transport) as made:
        await made.running()
        made.server.on_frame = on("Request", CanAction(bus_off=True))
        started_s = time.monotonic()
        with pytest.raises(CyclerConnectionError, match="bus-off: check wiring"):
            await made.driver.sample()
        assert time.monotonic() - started_s < TIMEOUT_S
        await made.driver.safe()
        assert made.at_rest


async def test_other_error_frames_are_counted(made):
    await made.running()
    with joined(made) as bus:
        bus.send(can.Message(arbitration_id=0x08, is_error_frame=True, is_extended_id=False, data=bytes(8)))
        await asyncio.sleep(0.1)
        assert (await made.driver.sample()).output_on
    assert made.driver._link.error_frames == 1
    made.server.on_frame = on("Request", CanAction(execute=False))
    with pytest.raises(CyclerTimeoutError, match="1 error frames"):
        await made.driver.sample()


async def test_own_frames_that_come_back_are_no_answer(udp):
    """Multicast returns what was sent; taken for the device's, it would confirm everything."""
    assert (await udp.running()).output_on
    assert udp.driver._link.error_frames == 0
    udp.server.on_frame = on("Command", CanAction(execute=False))
    with pytest.raises(CyclerTimeoutError, match="'CommandEcho'"):
        await udp.driver.apply(1.0)


@pytest.mark.parametrize("transport", ["can-virtual", "can-udp"])
async def test_a_second_master_is_noticed(transport):
    async with rig(transport) as made:
        await made.running()
        with joined(made) as bus:
            data = CanCodec(MAP.dbc).encode(SETPOINT, {"SetCurrent": 9.0, "Heartbeat": 1, "Tick": 1})
            bus.send(can.Message(arbitration_id=0x100, data=data, is_extended_id=False))
            await asyncio.sleep(0.1)
        with pytest.raises(CyclerProtocolError, match="another sender uses identifier 0x100"):
            await made.driver.sample()
        # Coming back forgets what was seen, as identifying the device begins anew.
        await made.driver.close()
        await made.driver.safe()
        assert made.at_rest


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
    assert _bus_arguments(address, False)["hop_limit"] == 0
    with can.Bus(**_bus_arguments(address, False)) as bus:
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
        other = open_cycler(address, "generic_can", TIMEOUT_S)
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
    from drivers.can_link import _Receiver

    await made.running()
    link = made.driver._link
    told = []
    receiver = _Receiver(LostBus(link._bus), told.append, link._failed, lenient=False)
    async with asyncio.timeout(2):
        while link.is_open:
            await asyncio.sleep(0.01)
    receiver.close()
    assert not told
    with pytest.raises(CyclerConnectionError, match="the bus is lost: adapter unplugged"):
        await made.driver.sample()


def cyclic_map(tmp_path):
    """The generic map with its sample sent by the device unasked."""
    text = MAP.file.read_text().replace('"generic_can.dbc"', f'"{MAP.dbc}"')
    start, end = text.index("[ask.sample]"), text.index("# Commands;")
    path = tmp_path / "cyclic.toml"
    path.write_text(text[:start] + text[end:])
    return path


async def test_cyclic_messages_have_an_age(tmp_path):
    async with rig("can-virtual", lock_step=False) as made:
        driver = open_cycler(made.address, cyclic_map(tmp_path), TIMEOUT_S)
        await driver.connect()
        with pytest.raises(CyclerTimeoutError, match="has not come yet"):
            await driver.sample()
        device, node = made.device, made.server
        for name in ("Electrical", "Condition", "State"):
            node._port.send(device.layouts[name].id, device._message(name, {}), extended=False)
        await asyncio.sleep(0.1)
        assert (await driver.sample()).voltage_V > 3.0
        await asyncio.sleep(0.5)
        with pytest.raises(CyclerTimeoutError, match=r"cyclic message '\w+' last came .* limit 0.5 s"):
            await driver.sample()
        await driver.close()


@pytest.mark.parametrize("suffix", ["", ".asc", ".log"])
async def test_the_traffic_of_a_run_is_logged(made, tmp_path, suffix):
    folder = tmp_path / f"traffic{suffix}"
    driver = made.another(f"&log={folder}")
    await driver.connect()
    for _ in range(2):  # each run has a file of its own
        await driver.acquire(LIMITS, 1.0, 0.1)
        await driver.output(True)
        wanted = []
        for current_A in (1.0, -2.5):
            await driver.apply(current_A)
            wanted.append((await driver.sample()).voltage_V)
        await driver.safe()
        await driver.release()
    await driver.close()
    first, second = sorted(folder.iterdir())
    database = cantools.database.load_file(MAP.dbc)
    seen = {"Command": [], "Electrical": []}
    with can.LogReader(second) as log:
        for message in log:
            name = database.get_message_by_frame_id(message.arbitration_id).name
            seen.setdefault(name, []).append(database.decode_message(name, message.data))
    assert [round(values["SetCurrent"], 4) for values in seen["Command"]][-2:] == [1.0, -2.5]
    voltages = [values["Voltage"] for values in seen["Electrical"]]
    assert all(voltage in voltages for voltage in wanted)
    assert first.stat().st_size > 0


async def test_another_program_decodes_the_traffic_to_the_same_values(made, tmp_path):
    """The decoder of cantools' command line reads the candump form of the log."""
    driver = made.another(f"&log={tmp_path / 'traffic.log'}")
    await driver.connect()
    await driver.acquire(LIMITS, 1.0, 0.1)
    await driver.output(True)
    await driver.apply(-2.5)
    reading = await driver.sample()
    await driver.safe()
    await driver.close()
    (path,) = (tmp_path / "traffic.log").iterdir()
    done = subprocess.run(
        [sys.executable, "-m", "cantools", "decode", "--single-line", str(MAP.dbc)],
        input=path.read_text(), capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    assert f"Voltage: {reading.voltage_V:.4f} V".replace("0 V", " V") in done.stdout.replace("0 V", " V")
    assert "SetCurrent: -2.5 A" in done.stdout and "OutputOn: 1" in done.stdout


async def test_a_log_that_cannot_be_written_does_not_stop_a_run(made, tmp_path, caplog):
    (tmp_path / "file").write_text("")
    driver = made.another(f"&log={tmp_path / 'file' / 'x'}")
    await driver.connect()
    await driver.acquire(LIMITS, 1.0, 0.1)
    assert "CAN traffic is not logged" in caplog.text
    await driver.close()


async def test_a_link_can_be_built_by_hand():
    codec = CanCodec(MAP.dbc)
    link = CanLink(
        parse_address("can://virtual/alone"),
        sends=codec.identifiers({"Request"}),
        receives=codec.identifiers({"Info"}),
        node_step=16,
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


FD_DBC = """\
VERSION ""
BU_: Bench Cycler
BO_ 2566848512 Tell: 4 Bench
 SG_ Charge : 0|16@1+ (0.01,0) [0|655.35] "A" Cycler
 SG_ Discharge : 16|16@1+ (0.01,0) [0|655.35] "A" Cycler
BO_ 2566848513 Switch: 1 Bench
 SG_ On : 0|1@1+ (1,0) [0|1] "" Cycler
BO_ 2566848514 Ask: 1 Bench
 SG_ What : 0|8@1+ (1,0) [0|255] "" Cycler
BO_ 2566848515 Everything: 16 Cycler
 SG_ Class : 0|16@1+ (1,0) [0|65535] "" Bench
 SG_ Volts : 16|16@1+ (0.001,0) [0|65.535] "V" Bench
 SG_ Amps : 32|16@1+ (0.01,0) [0|655.35] "A" Bench
 SG_ Sinking : 48|1@1+ (1,0) [0|1] "" Bench
 SG_ Running : 49|1@1+ (1,0) [0|1] "" Bench
 SG_ Celsius : 64|16@1- (0.1,0) [-50|150] "degC" Bench
 SG_ Count : 96|32@1+ (1,0) [0|4294967295] "" Bench
"""
FD_MAP = """\
schema = 1
name = "made_up"
title = "Made-up"
source = "this test"
verified_on_hardware = false
transport = "can"
dbc = "made_up.dbc"
fd = true
worst_reply_s = 0.05
positive_current = "charge"
identity = { signal = "Everything.Class", equals = 77 }
capabilities = { current = ["-20", "20"], voltage = ["0", "6"], watchdog = ["0.1", "10"] }
ask.all = { send = "Ask", values = { What = 1 }, replies = ["Everything"] }
command.tell = { send = "Tell", values = { Charge = "charge", Discharge = "discharge" } }
command.switch = { send = "Switch", values = { On = "output" } }
role.actual_voltage = { signal = "Everything.Volts" }
role.actual_current = { signal = "Everything.Amps", negative = "Everything.Sinking" }
role.temperature = { signal = "Everything.Celsius" }
role.sequence = { signal = "Everything.Count" }
status = { output_on = "Everything.Running" }
sequence.tick = [{ command = "tell" }]
sequence.output = [{ command = "switch" }]
sequence.safe = [{ command = "switch", output = false }]
"""


async def test_a_made_up_cycler_with_long_frames_and_two_set_points_is_one_map(tmp_path):
    """CAN FD, extended identifiers, unsigned values, no echo: nothing of it needs a line of code."""
    (tmp_path / "made_up.dbc").write_text(FD_DBC)
    path = tmp_path / "made_up.toml"
    path.write_text(FD_MAP)
    async with rig("can-virtual", lock_step=False, map_name=str(path)) as made:
        able = await made.driver.connect()
        assert able.current_A == (-20.0, 20.0) and able.watchdog_s == (0.1, 10.0) and able.has_sequence
        await made.running(4.0)
        for current_A in (-2.5, 4.0):
            await made.driver.apply(current_A)
            await asyncio.sleep(0.05)
            reading = await made.driver.sample()
            assert reading.current_A == pytest.approx(current_A, abs=0.02) and reading.output_on
            assert reading.temperature_degC == pytest.approx(25.0, abs=0.2)
        await made.driver.safe()
        assert made.at_rest
