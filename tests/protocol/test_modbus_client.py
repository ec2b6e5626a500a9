"""The Modbus TCP client on a socket of its own, against a server that answers byte by byte what the test wants."""

import asyncio
import struct
import time

import pytest
from pymodbus.exceptions import ConnectionException, ModbusIOException

from drivers.modbus_tcp import TcpClient
from tests.patience import FACTOR

LONG_S = 20.0 * FACTOR  # for an answer that comes; a test of silence sets its own


class Server:
    """Keeps the requests; `answers` are sent one after the other, as they are or made from the request's header."""

    def __init__(self, *answers):
        self.answers = list(answers)
        self.requests = []

    async def __aenter__(self):
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.client = TcpClient("127.0.0.1", self._server.sockets[0].getsockname()[1], LONG_S, self._changed)
        self.changes = []
        assert await self.client.connect()
        return self

    async def __aexit__(self, *_):
        self.client.close()
        self._server.close()
        await self._server.wait_closed()

    def _changed(self, connected):
        self.changes.append(connected)

    async def _serve(self, reader, writer):
        try:
            while True:
                header = await reader.readexactly(7)
                self.requests.append(await reader.readexactly(int.from_bytes(header[4:6], "big") - 1))
                for piece in self.answers.pop(0)(int.from_bytes(header[:2], "big")):
                    writer.write(piece)
                    await writer.drain()
                    await asyncio.sleep(0.005)
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            writer.close()


def frame(transaction, pdu, protocol=0):
    return struct.pack(">HHHB", transaction, protocol, len(pdu) + 1, 1) + pdu


def answer(pdu):
    return lambda transaction: [frame(transaction, pdu)]


TWO = bytes.fromhex("03 04 0001 0002")


async def read(client):
    return await client.read_holding_registers(100, count=2, device_id=1)


async def test_requests_are_what_the_protocol_says():
    echo5, echo6 = bytes.fromhex("05 0007 FF00"), bytes.fromhex("06 0064 1234")
    answers = [
        TWO,
        b"\x04" + TWO[1:],
        echo6,
        b"\x10\x00\x64\x00\x02",
        echo5,
        b"\x0f\x00\x07\x00\x03",
        b"\x17" + TWO[1:],
    ]
    async with Server(*map(answer, answers)) as made:
        client = made.client
        assert (await read(client)).registers == (1, 2)
        assert (await client.read_input_registers(100, count=2, device_id=1)).registers == (1, 2)
        seen = await client.write_register(100, 0x1234, device_id=1)
        assert (seen.address, seen.registers) == (100, (0x1234,))
        seen = await client.write_registers(100, [1, 2], device_id=1)
        assert (seen.address, seen.count) == (100, 2)
        assert (await client.write_coil(7, True, device_id=1)).bits == (True,)
        assert (await client.write_coils(7, [True, False, True], device_id=1)).count == 3
        found = await client.readwrite_registers(read_address=1, read_count=2, write_address=3, values=[4], device_id=1)
        assert found.registers == (1, 2)
        assert [request.hex() for request in made.requests] == [
            "0300640002", "0400640002", "0600641234", "10006400020400010002", "050007ff00", "0f000700030105",
            "1700010002000300010200" + "04",
        ]  # fmt: skip


async def test_an_answer_in_pieces_and_behind_a_late_one():
    def pieces(transaction):
        data = frame(transaction - 1, TWO[:-1] + b"\x09") + frame(transaction, TWO)
        return [data[i : i + 5] for i in range(0, len(data), 5)]

    async with Server(pieces) as made:
        assert (await read(made.client)).registers == (1, 2)


async def test_no_answer_in_time_and_the_late_one_is_nobodys():
    async with Server(lambda _: [], lambda transaction: [frame(transaction - 1, TWO), frame(transaction, TWO)]) as made:
        made.client.timeout_s = 0.05
        started_s = time.monotonic()
        with pytest.raises(ModbusIOException, match="no answer in time"):
            await read(made.client)
        assert 0.04 < time.monotonic() - started_s < 0.9 * LONG_S, "the time-out in force is the client's own"
        assert (await read(made.client)).registers == (1, 2)


async def test_an_answer_of_another_unit_is_nobodys():
    other = struct.pack(">B", 9) + TWO
    async with Server(lambda t: [struct.pack(">HHH", t, 0, len(other)) + other]) as made:
        made.client.timeout_s = 0.05
        with pytest.raises(ModbusIOException, match="no answer in time"):
            await read(made.client)


@pytest.mark.parametrize(
    "data",
    [
        lambda t: [frame(t, TWO, protocol=7)],
        lambda t: [struct.pack(">HHH", t, 0, 0) + b"\x01"],
        lambda t: [frame(t, b"\x03\x04\x00")],
        lambda t: [frame(t, b"\x83")],
        lambda t: [frame(t, b"\x83\x02\x00")],
    ],
    ids=["protocol", "length", "registers cut", "exception cut", "exception long"],
)
async def test_an_answer_that_is_no_modbus(data):
    async with Server(data) as made:
        with pytest.raises((ConnectionException, ModbusIOException)):
            await read(made.client)


async def test_an_exception_is_returned():
    async with Server(answer(b"\x83\x02"), answer(b"\x86\x03"), answer(b"\x06\x00")) as made:
        assert (await read(made.client)).exception_code == 2
        assert (await made.client.write_register(1, 1, device_id=1)).exception_code == 3
        with pytest.raises(ConnectionException, match="no Modbus"):
            await made.client.write_register(1, 1, device_id=1)


async def test_a_connection_that_goes_away():
    def gone(_):
        raise ConnectionError

    async with Server(gone) as made:
        with pytest.raises(ConnectionException, match="connection lost"):
            await read(made.client)
        assert not made.client.connected and made.changes == [True, False]
        with pytest.raises(ConnectionException, match="not connected"):
            await read(made.client)


async def test_nobody_listens(unused_tcp_port):
    client = TcpClient("127.0.0.1", unused_tcp_port, 0.2, lambda _: None)
    assert not await client.connect() and not client.connected
    client.close()
