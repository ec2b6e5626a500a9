"""The driver against the simulated cycler on a pseudo-terminal that is paced to its baud rate."""

import asyncio
import os
import time

import pytest
from pymodbus.client import AsyncModbusSerialClient

from drivers.address import SerialAddress
from drivers.cycler import (
    CyclerConnectionError,
    CyclerProtocolError,
    CyclerTimeoutError,
    DeviceLimits,
    SetPointRefusedError,
)
from drivers.factory import open_cycler
from drivers.modbus_link import ModbusLink, serial_client_factory
from drivers.register_map import load_map
from simulators.bench import SimulatorSettings, build_device
from simulators.modbus_server import Action, delay
from simulators.rtu_server import RtuServer, crc16
from simulators.serial_line import SerialSettings

LIMITS = DeviceLimits((2.5, 4.25), (-10.0, 10.0), (-10.0, 60.0), None)
TIMEOUT_S = 0.15
LATE_S = 0.25  # after the time-out, within the map's worst reply time
FAST = 921_600


class Rig:
    def __init__(self, lock_step=True, baud=FAST, options="", **line):
        self.lock_step, self.baud, self.options = lock_step, baud, options
        self.device = build_device(SimulatorSettings(lock_step=lock_step))
        self.server = RtuServer(self.device, SerialSettings(baud=baud, **line))

    async def __aenter__(self):
        self.port = await self.server.start()
        self.driver = open_cycler(f"modbus-rtu://{self.port}?baud={self.baud}{self.options}", "generic", TIMEOUT_S)
        return self

    async def __aexit__(self, *_):
        await self.driver.close()
        await self.server.close()

    async def running(self, current_A=2.0):
        """In the middle of a pulse."""
        await self.driver.connect()
        await self.driver.acquire(LIMITS, 1.0, 0.1 if self.lock_step else None)
        await self.driver.output(True)
        await self.driver.sample()
        await self.driver.apply(current_A)
        return await self.driver.sample()

    @property
    def at_rest(self):
        return not self.device.cycler.output_on and self.device.cycler.set_point_A == 0.0


@pytest.fixture
async def rig():
    async with Rig() as made:
        yield made


def once(action):
    """Fault hook that acts on the next request and then lets everything pass."""
    left = [action]
    return lambda frame: left.pop() if left else None


async def test_a_life_in_lock_step(rig):
    assert (await rig.driver.connect()).serial == "1"
    before = await rig.running(-2.5)
    assert before.setpoint_in_force_A == -2.5 and before.output_on
    for k, current_A in enumerate((1.0, 0.1), start=1):
        await rig.driver.apply(current_A)
        reading = await rig.driver.sample()
        assert reading.sequence == before.sequence + k
        assert reading.current_A == pytest.approx(current_A, abs=0.02)
    await rig.driver.safe()
    assert rig.at_rest
    await rig.driver.release()


async def test_the_line_is_as_slow_as_its_baud_rate():
    async with Rig(baud=9600) as rig:
        await rig.driver.connect()
        started_s = time.monotonic()
        await rig.driver.sample()
        assert time.monotonic() - started_s >= (8 + 29) * 10 / 9600


async def _three_reads(client):
    """Registers that three reads of different places bring; None for a time-out."""
    found = []
    for address in (2, 4, 100):
        try:
            found.append(await client(address))
        except Exception:  # whichever way a client tells of it
            found.append(None)
    return found


async def test_without_the_rule_a_late_answer_is_taken_for_the_next_one(rig):
    """Why the driver stays silent after a time-out: what a client without that rule makes of one late answer."""
    rig.device.cycler.set_remote(True)
    right = [rig.device.read("holding", address, 2) for address in (2, 4, 100)]
    client = AsyncModbusSerialClient(rig.port, baudrate=FAST, timeout=TIMEOUT_S, retries=0, reconnect_delay=0)
    await client.connect()

    async def read(address):
        reply = await client.read_holding_registers(address, count=2, device_id=1)
        return b"".join(word.to_bytes(2, "big") for word in reply.registers)

    rig.server.on_request = once(delay(LATE_S))
    careless = await _three_reads(read)
    client.close()
    assert careless[0] is None
    assert careless[1] == right[0] != right[1], "the second read got the answer to the first"

    map_ = load_map("generic")
    link = ModbusLink(
        "line",
        serial_client_factory(SerialAddress(rig.port, FAST)),
        unit_id=1,
        functions=map_.functions,
        min_gap_s=0.0,
        timeout_s=TIMEOUT_S,
        silence_s=map_.worst_reply_s,
    )

    async def careful_read(address):
        if not link.is_open:
            await link.open()
        words = await link.read_registers("holding", address, 2, "two registers")
        return b"".join(word.to_bytes(2, "big") for word in words)

    await link.open()
    rig.server.on_request = once(delay(LATE_S))
    assert await _three_reads(careful_read) == [None, *right[1:]]
    link.close()


async def test_a_late_answer_in_a_pulse_ends_it_safely(rig):
    await rig.running()
    rig.server.on_request = once(delay(LATE_S))
    with pytest.raises(CyclerTimeoutError, match=r"no answer within 0\.15 s"):
        await rig.driver.sample()
    with pytest.raises(CyclerConnectionError, match="not connected"):
        await rig.driver.sample()
    await rig.driver.safe()
    assert rig.at_rest
    reading = await rig.driver.sample()
    assert not reading.output_on and reading.voltage_V > 2.5


async def test_a_cancelled_request_leaves_no_answer_for_the_next(rig):
    await rig.running()
    rig.server.on_request = once(delay(0.1))
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(rig.driver.sample(), 0.03)
    await rig.driver.safe()
    assert rig.at_rest and (await rig.driver.sample()).voltage_V > 2.5


async def test_a_second_program_does_not_get_the_answer_meant_for_the_first(rig):
    careless = AsyncModbusSerialClient(rig.port, baudrate=FAST, timeout=0.01, retries=0, reconnect_delay=0)
    await careless.connect()
    rig.server.on_request = once(delay(0.1))
    with pytest.raises(Exception, match="No response"):
        await careless.read_holding_registers(200, count=1, device_id=1)
    careless.close()
    assert (await rig.driver.connect()).serial == "1"


@pytest.mark.parametrize(
    "action",
    [
        Action(corrupt=True),
        Action(unit_id=9),
        Action(change=lambda _, answer: answer[:-1]),
        Action(execute=False, reply=False),
    ],
    ids=["check sum", "other unit", "cut short", "silence"],
)
async def test_an_answer_that_is_none(rig, action):
    await rig.running()
    rig.server.on_request = once(action)
    with pytest.raises(CyclerTimeoutError):
        await rig.driver.sample()
    await rig.driver.safe()
    assert rig.at_rest


async def test_an_answer_of_another_length_closes_the_line(rig):
    await rig.running()
    rig.server.on_request = once(Action(change=lambda _, answer: b"\x03\x04" + answer[2:6]))
    with pytest.raises(CyclerProtocolError, match="2 registers came back, 12 were asked for"):
        await rig.driver.sample()
    with pytest.raises(CyclerConnectionError, match="not connected"):
        await rig.driver.sample()


async def test_an_exception_keeps_the_line_open(rig):
    await rig.running()
    rig.server.on_request = once(Action(exception=6))
    with pytest.raises(CyclerProtocolError, match=r"exception 6 \(device busy\)"):
        await rig.driver.sample()
    assert (await rig.driver.sample()).output_on


async def test_own_bytes_heard_again():
    async with Rig(echo=True) as rig:
        # An echo of function 5 looks like its answer; the answer itself then does not fit the next request.
        with pytest.raises((CyclerTimeoutError, CyclerProtocolError)):
            await rig.running()
        assert not rig.device.cycler.output_on
    async with Rig(echo=True, options="&echo=1") as rig:
        assert (await rig.running()).output_on
        await rig.driver.safe()
        assert rig.at_rest


async def test_a_line_that_cannot_switch_direction(rig):
    driver = open_cycler(f"modbus-rtu://{rig.port}?baud={FAST}&rs485=1", "generic", TIMEOUT_S)
    with pytest.raises(CyclerConnectionError, match="takes no RS-485 direction control"):
        await driver.connect()


async def test_no_such_device():
    driver = open_cycler("modbus-rtu:///dev/there-is-none", "generic", TIMEOUT_S)
    with pytest.raises(CyclerConnectionError, match="cannot connect"):
        await driver.connect()


async def test_two_programs_do_not_share_a_line(rig):
    await rig.driver.connect()
    other = open_cycler(f"modbus-rtu://{rig.port}?baud={FAST}", "generic", TIMEOUT_S)
    with pytest.raises(CyclerConnectionError, match="taken by another program"):
        await other.connect()


async def test_another_unit_on_the_line_is_not_answered(rig):
    driver = open_cycler(f"modbus-rtu://{rig.port}?baud={FAST}&unit=2", "generic", TIMEOUT_S)
    with pytest.raises(CyclerTimeoutError):
        await driver.connect()
    await driver.close()


async def test_a_refused_set_point(rig):
    await rig.running()
    rig.device.cycler.set_limit("current_high", 1.0)
    with pytest.raises((CyclerProtocolError, SetPointRefusedError)):
        await rig.driver.apply(5.0)
        await rig.driver.sample()


async def raw(rig, *pieces, pause_s=0.0):
    """Send bytes as they are and return what comes back."""
    fd = os.open(rig.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        for piece in pieces:
            os.write(fd, piece)
            await asyncio.sleep(pause_s)
        await asyncio.sleep(0.1)
        try:
            return os.read(fd, 512)
        except BlockingIOError:
            return b""
    finally:
        os.close(fd)


READ_CLASS = bytes.fromhex("01 03 0000 0001 840A")  # the check sum stands in many manuals for this very request


async def test_frames_in_pieces_and_after_garbage(rig):
    answer = bytes.fromhex("01 03 02 4254")
    answer += crc16(answer)
    assert crc16(READ_CLASS[:-2]) == READ_CLASS[-2:]
    assert await raw(rig, READ_CLASS) == answer
    assert await raw(rig, READ_CLASS[:3], READ_CLASS[3:], pause_s=0.002) == answer
    assert await raw(rig, b"\x01\x03\xff", READ_CLASS, pause_s=0.2) == answer  # half a frame, then silence
    assert await raw(rig, READ_CLASS[:-1] + b"\x00") == b""
    assert await raw(rig, b"\x00" + READ_CLASS[1:-2] + crc16(b"\x00" + READ_CLASS[1:-2])) == b""  # to all: no answer
    unknown = b"\x01\x2b\x0e\x01"
    assert await raw(rig, unknown + crc16(unknown)) == b"\x01\xab\x01" + crc16(b"\x01\xab\x01")


async def test_a_link_to_the_pseudo_terminal(tmp_path):
    link = tmp_path / "cycler"
    server = RtuServer(build_device(SimulatorSettings()), SerialSettings(device=str(link)))
    assert await server.start() == str(link) and link.is_symlink()
    await server.close()
    assert not link.exists()
