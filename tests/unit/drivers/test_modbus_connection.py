"""When a connection is closed, and what each failure is called, with a client that answers by rote."""

import asyncio
import time

import pytest
from pymodbus.exceptions import ConnectionException, ModbusIOException

from drivers.errors import CyclerConnectionError, CyclerProtocolError, CyclerTimeoutError
from drivers.modbus_connection import ModbusConnection
from drivers.modbus_link import ModbusLink
from drivers.modbus_tcp import Reply

EVERY = frozenset((1, 3, 4, 5, 6, 15, 16, 23))


class Client:
    """Answers every request with one reply, or raises."""

    def __init__(self, reply, *, reachable=True):
        self._reply, self._reachable = reply, reachable
        self.connected, self.timeout_s = False, 0.0

    async def connect(self):
        self.connected = self._reachable
        return self._reachable

    def close(self):
        self.connected = False

    async def answer(self, *_, **__):
        if isinstance(self._reply, BaseException):
            raise self._reply
        return self._reply

    read_holding_registers = read_input_registers = write_register = write_registers = answer
    write_coil = write_coils = readwrite_registers = answer


@pytest.fixture(autouse=True)
def clients_of_our_own(monkeypatch):
    monkeypatch.setattr("drivers.modbus_connection.set_timeout", lambda client, time_s: None)


def connection(reply, *, silence_s=0.0, reachable=True):
    made = Client(reply, reachable=reachable)
    return ModbusConnection(
        "there",
        lambda on_change: made,  # pyright: ignore[reportArgumentType]
        min_gap_s=0.0,
        timeout_s=0.1,
        silence_s=silence_s,
        rs485=False,
    )


def link(reply, *, functions=EVERY, silence_s=0.0):
    return ModbusLink(
        "there",
        lambda on_change: Client(reply),  # pyright: ignore[reportArgumentType]
        unit_id=1,
        functions=functions,
        min_gap_s=0.0,
        timeout_s=0.1,
        silence_s=silence_s,
    )


async def exchanged(made, function=3):
    await made.open()
    return await made.exchange(function, "reading", "'x'", made.client("x").read_holding_registers)


async def test_nobody_there():
    made = connection(Reply(3), reachable=False)
    with pytest.raises(CyclerConnectionError, match="there: cannot connect within 1 s"):
        await made.open()
    assert not made.is_open
    with pytest.raises(CyclerConnectionError, match="there: x: not connected"):
        made.client("x")


@pytest.mark.parametrize("silence_s", [0.0, 0.01])
@pytest.mark.parametrize(
    ("reply", "error", "closed"),
    [
        (Reply(3), None, False),
        (Reply(0x83, exception_code=2), CyclerProtocolError, False),  # the device has answered
        (Reply(4), CyclerProtocolError, True),  # to another request
        (ConnectionException("gone"), CyclerConnectionError, True),
        (ModbusIOException("silent"), CyclerTimeoutError, True),  # a late answer must not meet a later request
    ],
)
async def test_what_becomes_of_the_connection(reply, error, closed, silence_s):
    made = connection(reply, silence_s=silence_s)
    if error is None:
        assert await exchanged(made) is reply
    else:
        with pytest.raises(error, match="there: reading 'x': "):
            await exchanged(made)
    assert made.is_open != closed


async def test_a_cancelled_request_leaves_no_line_on_which_its_answer_may_come():
    for silence_s, stays in ((0.0, True), (0.01, False)):  # replies over TCP carry the number of their request
        made = connection(asyncio.CancelledError(), silence_s=silence_s)
        with pytest.raises(asyncio.CancelledError):
            await exchanged(made)
        assert made.is_open == stays


async def test_a_mistrusted_line_stays_silent_for_the_worst_reply_time():
    made = connection(Reply(3), silence_s=0.05)
    await made.open()
    made.mistrust()
    started_s = time.monotonic()
    await made.open()
    assert time.monotonic() - started_s >= 0.045 and made.is_open


async def test_exactly_the_registers_that_were_asked_for():
    for count, ok in ((2, True), (1, False), (3, False)):
        made = link(Reply(3, registers=(7,) * count), silence_s=0.001)
        await made.open()
        if ok:
            assert await made.read_registers("holding", 0, 2, "'x'") == [7, 7]
        else:
            with pytest.raises(CyclerProtocolError, match=f"{count} registers came back, 2 were asked for"):
                await made.read_registers("holding", 0, 2, "'x'")
        assert made.is_open == ok


@pytest.mark.parametrize(
    ("functions", "values", "reply"),
    [
        (EVERY, [5], Reply(6, address=9, registers=(5,))),
        (EVERY - {6}, [5], Reply(16, address=9, count=1)),
        (EVERY, [5, 6], Reply(16, address=9, count=2)),
    ],
)
async def test_a_write_is_repeated_by_its_reply(functions, values, reply):
    made = link(reply, functions=functions)
    await made.open()
    await made.write_registers(9, values, "'x'")
    with pytest.raises(CyclerProtocolError, match="the reply repeats"):
        await made.write_registers(8, values, "'x'")


@pytest.mark.parametrize(
    ("functions", "reply"),
    [(EVERY, Reply(5, address=2, bits=(True,))), (EVERY - {5}, Reply(15, address=2, count=1))],
)
async def test_a_coil_is_repeated_by_its_reply(functions, reply):
    made = link(reply, functions=functions)
    await made.open()
    await made.write_coil(2, True, "'x'")
    with pytest.raises(CyclerProtocolError, match="the reply repeats"):
        await made.write_coil(3, True, "'x'")


async def test_a_function_that_the_map_does_not_allow_is_never_sent():
    made = link(ConnectionException("was sent"), functions=frozenset((6,)))
    await made.open()
    for call in (
        made.read_registers("holding", 0, 1, "'x'"),
        made.read_registers("input", 0, 1, "'x'"),
        made.write_registers(0, [1, 2], "'x'"),
        made.write_then_read(0, [1], 0, 1, "'x'"),
        made.write_coil(0, True, "'x'"),
    ):
        with pytest.raises(CyclerProtocolError, match="the map does not allow function"):
            await call
