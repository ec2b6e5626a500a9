"""What only a serial line has: no transaction numbers, a pace, an echo, one program at a time, frames in pieces."""

import asyncio
import contextlib
import os
import time

import pytest
from pymodbus.client import AsyncModbusSerialClient

from drivers.address import SerialAddress
from drivers.cycler import (
    CyclerConnectionError,
    CyclerProtocolError,
    CyclerTimeoutError,
)
from drivers.factory import open_cycler
from drivers.modbus_clients import serial_client_factory
from drivers.modbus_link import ModbusLink
from drivers.register_map import load_map
from simulators.bench import SimulatorSettings, build_device
from simulators.modbus_actions import Action, delay
from simulators.rtu_server import RtuServer, crc16
from simulators.serial_line import SerialSettings
from tests.patience import PATIENCE_S
from tests.protocol.rigs import FAST_LINE, rig

TIMEOUT_S = 0.15  # of the fixture `rtu`

FAST = FAST_LINE.baud

LATE_S = 0.25  # after the time-out, within the map's worst reply time

# A client without the rule gets the late answer in the midst of its second read, half a second from either end of it: a
# busy machine may be late itself.
CARELESS_S, CARELESS_LATE_S = 1.0, 1.5


def once(action):
    """Fault hook that acts on the next request and then lets everything pass."""
    left = [action]
    return lambda frame: left.pop() if left else None


async def test_the_line_is_as_slow_as_its_baud_rate():
    async with rig("modbus-rtu", line=SerialSettings(baud=9600)) as rtu:
        await rtu.driver.connect()
        started_s = time.monotonic()
        await rtu.driver.sample()
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


async def test_without_the_rule_a_late_answer_is_taken_for_the_next_one(rtu):
    """Why the driver stays silent after a time-out: what a client without that rule makes of one late answer."""
    rtu.device.cycler.set_remote(True)
    right = [rtu.device.read("holding", address, 2) for address in (2, 4, 100)]
    client = AsyncModbusSerialClient(rtu.port, baudrate=FAST, timeout=CARELESS_S, retries=0, reconnect_delay=0)
    await client.connect()

    async def read(address):
        reply = await client.read_holding_registers(address, count=2, device_id=1)
        return b"".join(word.to_bytes(2, "big") for word in reply.registers)

    rtu.server.on_request = once(delay(CARELESS_LATE_S))
    careless = await _three_reads(read)
    client.close()
    assert careless[0] is None
    assert careless[1] == right[0] != right[1], "the second read got the answer to the first"

    map_ = load_map("generic")
    link = ModbusLink(
        "line",
        serial_client_factory(SerialAddress(rtu.port, FAST)),
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
    rtu.server.on_request = once(delay(LATE_S))
    assert await _three_reads(careful_read) == [None, *right[1:]]
    link.close()


async def test_a_late_answer_in_a_pulse_ends_it_safely(rtu):
    await rtu.running()
    rtu.server.on_request = once(delay(LATE_S))
    with rtu.impatient(), pytest.raises(CyclerTimeoutError, match=r"no answer within 0\.15 s"):
        await rtu.driver.sample()
    with pytest.raises(CyclerConnectionError, match="not connected"):
        await rtu.driver.sample()
    await rtu.driver.safe()
    assert rtu.at_rest
    reading = await rtu.driver.sample()
    assert not reading.output_on and reading.voltage_V > 2.5


async def test_a_cancelled_request_leaves_no_answer_for_the_next(rtu):
    await rtu.running()
    rtu.server.on_request = once(delay(0.1))
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(rtu.driver.sample(), 0.03)
    await rtu.driver.safe()
    assert rtu.at_rest and (await rtu.driver.sample()).voltage_V > 2.5


async def test_a_second_program_does_not_get_the_answer_meant_for_the_first(rtu):
    careless = AsyncModbusSerialClient(rtu.port, baudrate=FAST, timeout=0.01, retries=0, reconnect_delay=0)
    await careless.connect()
    rtu.server.on_request = once(delay(0.1))
    with pytest.raises(Exception, match="No response"):
        await careless.read_holding_registers(200, count=1, device_id=1)
    careless.close()
    assert (await rtu.driver.connect()).serial == "1"


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
async def test_an_answer_that_is_none(rtu, action):
    await rtu.running()
    rtu.server.on_request = once(action)
    with rtu.impatient(), pytest.raises(CyclerTimeoutError):
        await rtu.driver.sample()
    await rtu.driver.safe()
    assert rtu.at_rest


async def test_an_answer_of_another_length_closes_the_line(rtu):
    await rtu.running()
    rtu.server.on_request = once(Action(change=lambda _, answer: b"\x03\x04" + answer[2:6]))
    with pytest.raises(CyclerProtocolError, match="2 registers came back, 12 were asked for"):
        await rtu.driver.sample()
    with pytest.raises(CyclerConnectionError, match="not connected"):
        await rtu.driver.sample()


async def test_an_exception_keeps_the_line_open(rtu):
    await rtu.running()
    rtu.server.on_request = once(Action(exception=6))
    with pytest.raises(CyclerProtocolError, match=r"exception 6 \(device busy\)"):
        await rtu.driver.sample()
    assert (await rtu.driver.sample()).output_on


async def test_own_bytes_heard_again():
    echoing = SerialSettings(baud=FAST, echo=True)
    async with rig("modbus-rtu", timeout_s=TIMEOUT_S, line=echoing) as rtu:
        # An echo of function 5 looks like its answer; the answer itself then does not fit the next request.
        with rtu.impatient(), pytest.raises((CyclerTimeoutError, CyclerProtocolError)):
            await rtu.running()
        assert not rtu.device.cycler.output_on
    async with rig("modbus-rtu", timeout_s=TIMEOUT_S, line=echoing, options="&echo=1") as rtu:
        assert (await rtu.running()).output_on
        await rtu.driver.safe()
        assert rtu.at_rest


async def test_a_line_that_cannot_switch_direction(rtu):
    driver = open_cycler(f"modbus-rtu://{rtu.port}?baud={FAST}&rs485=1", "generic", TIMEOUT_S)
    with pytest.raises(CyclerConnectionError, match="takes no RS-485 direction control"):
        await driver.connect()


async def test_no_such_device():
    driver = open_cycler("modbus-rtu:///dev/there-is-none", "generic", TIMEOUT_S)
    with pytest.raises(CyclerConnectionError, match="cannot connect"):
        await driver.connect()


async def test_two_programs_do_not_share_a_line(rtu):
    await rtu.driver.connect()
    other = open_cycler(f"modbus-rtu://{rtu.port}?baud={FAST}", "generic", TIMEOUT_S)
    with pytest.raises(CyclerConnectionError, match="taken by another program"):
        await other.connect()


async def test_another_unit_on_the_line_is_not_answered(rtu):
    driver = open_cycler(f"modbus-rtu://{rtu.port}?baud={FAST}&unit=2", "generic", TIMEOUT_S)
    with pytest.raises(CyclerTimeoutError):
        await driver.connect()
    await driver.close()


async def raw(rtu, *pieces, pause_s=0.0, n=0):
    """Send bytes as they are and return what comes back: `n` bytes, or what has come after a moment."""
    fd = os.open(rtu.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        for piece in pieces:
            os.write(fd, piece)
            await asyncio.sleep(pause_s)
        answer, until_s = b"", time.monotonic() + (PATIENCE_S if n else 0.1)
        while time.monotonic() < until_s and (not n or len(answer) < n):
            with contextlib.suppress(BlockingIOError):
                answer += os.read(fd, 512)
            await asyncio.sleep(0.005)
        return answer
    finally:
        os.close(fd)


READ_CLASS = bytes.fromhex("01 03 0000 0001 840A")  # the check sum stands in many manuals for this very request


async def test_frames_in_pieces_and_after_garbage(rtu):
    answer = bytes.fromhex("01 03 02 4254")
    answer += crc16(answer)
    assert crc16(READ_CLASS[:-2]) == READ_CLASS[-2:]
    assert await raw(rtu, READ_CLASS, n=7) == answer
    assert await raw(rtu, READ_CLASS[:3], READ_CLASS[3:], pause_s=0.002, n=7) == answer
    assert await raw(rtu, b"\x01\x03\xff", READ_CLASS, pause_s=0.2, n=7) == answer  # half a frame, then silence
    assert await raw(rtu, READ_CLASS[:-1] + b"\x00") == b""
    assert await raw(rtu, b"\x00" + READ_CLASS[1:-2] + crc16(b"\x00" + READ_CLASS[1:-2])) == b""  # to all: no answer
    unknown = b"\x01\x2b\x0e\x01"
    assert await raw(rtu, unknown + crc16(unknown), n=5) == b"\x01\xab\x01" + crc16(b"\x01\xab\x01")


async def test_a_link_to_the_pseudo_terminal(tmp_path):
    link = tmp_path / "cycler"
    server = RtuServer(build_device(SimulatorSettings()), SerialSettings(device=str(link)))
    assert await server.start() == str(link) and link.is_symlink()
    await server.close()
    assert not link.exists()
