"""Framing, function codes and exceptions of the simulated Modbus TCP server, with frames written by hand."""

import asyncio
import math
import struct

import pytest

from simulators.modbus_actions import DROP, SILENCE, Action, Frame, delay
from tests.patience import PATIENCE_S, holds
from tests.protocol.raw_modbus import COMMAND_OK, rig, switch_on


async def test_back_to_back_requests_in_one_segment_are_all_answered_in_order() -> None:
    async with rig() as r:
        c = r.client
        c.writer.write(c.frame("03 0000 0001") + c.frame("06 0066 0007") + c.frame("03 0066 0001"))
        assert [await c.answer() for _ in range(3)] == [
            (1, 1, bytes.fromhex("03 02 4254")),
            (2, 1, bytes.fromhex("06 0066 0007")),
            (3, 1, bytes.fromhex("03 02 0007")),
        ]


async def test_request_that_arrives_byte_by_byte() -> None:
    async with rig() as r:
        c = r.client
        for byte in c.frame("03 0000 0002") + c.frame("01 0000 0003"):
            c.writer.write(bytes((byte,)))
            await c.writer.drain()
            await asyncio.sleep(0)
        assert await c.answer() == (1, 1, bytes.fromhex("03 04 4254 0001"))
        assert await c.answer() == (2, 1, bytes.fromhex("01 01 00"))


async def test_one_and_a_half_requests_then_the_rest() -> None:
    async with rig() as r:
        c = r.client
        first, second = c.frame("03 0000 0001"), c.frame("03 0001 0001")
        c.writer.write(first + second[:9])
        assert (await c.answer())[2] == bytes.fromhex("03 02 4254")
        c.writer.write(second[9:])
        assert await c.answer() == (2, 1, bytes.fromhex("03 02 0001"))


@pytest.mark.parametrize("head", ["0001 0001 0006 01", "0001 0000 0001 01", "0001 0000 0400 01"])
async def test_stream_that_cannot_be_framed_is_closed(head: str) -> None:
    async with rig() as r:
        r.client.writer.write(bytes.fromhex(head) + bytes(5))
        async with asyncio.timeout(PATIENCE_S):
            assert await r.client.reader.read() == b""
        other = await r.connect()
        assert await other.ask("03 0000 0001") == bytes.fromhex("03 02 4254")
        other.writer.close()


async def test_several_clients_share_the_device() -> None:
    async with rig() as r:
        other = await r.connect()
        await r.client.ask("06 0066 1234")
        assert await other.ask("03 0066 0001") == bytes.fromhex("03 02 1234")
        r.client.writer.close()
        await holds(lambda: len(r.server.connections) == 1, "one is left")
        assert await other.ask("03 0066 0001") == bytes.fromhex("03 02 1234")
        other.writer.close()


async def test_each_function_code() -> None:
    async with rig() as r:
        c = r.client
        assert await c.ask("0F 0000 0002 01 03") == bytes.fromhex("0F 0000 0002")  # remote and output on
        assert await c.ask("01 0000 0003") == bytes.fromhex("01 01 03")
        assert await c.ask("05 0001 0000") == bytes.fromhex("05 0001 0000")
        assert await c.ask("01 0001 0001") == bytes.fromhex("01 01 00")
        assert await c.ask("06 006E 05DC") == bytes.fromhex("06 006E 05DC")  # watchdog 1.5 s
        assert await c.ask("10 0078 0004 08 40866666 40200000") == bytes.fromhex("10 0078 0004")  # 4.2 V, 2.5 V
        assert await c.ask("03 0078 0004") == bytes.fromhex("03 08 40866666 40200000")
        # FC 23 writes before it reads: 2 A and tick 1 are in the block that comes back.
        reply = await c.ask("17 00C8 000C 0064 0005 0A 40000000 0005 00000001")
        sequence, setpoint = struct.unpack(">2xI12xf4x", reply)
        assert (sequence, setpoint) == (1, 2.0)


async def test_identity_and_constants() -> None:
    async with rig() as r:
        reply = await r.client.ask("03 0000 0008")
        assert struct.unpack(">2xHHffI", reply) == (0x4254, 1, 30.0, 6.0, 1)


@pytest.mark.parametrize(
    ("pdu", "answer"),
    [
        ("02 0000 0001", "82 01"),  # function that the device does not have
        ("2B 0E 01 00", "AB 01"),
        ("03 0009 0001", "83 02"),  # outside every block
        ("03 0008 0002", "83 02"),  # begins inside, ends outside
        ("03 0005 0061", "83 02"),
        ("03 FFFF 0001", "83 02"),
        ("06 00C8 0001", "86 02"),  # read-only
        ("06 0064 4000", "86 02"),  # half a value
        ("10 0064 0001 02 4000", "90 02"),
        ("05 0009 FF00", "85 02"),
        ("01 0002 0002", "81 02"),
        ("0F 0002 0002 01 03", "8F 02"),
        ("17 0009 0001 0066 0001 02 0001", "97 02"),
        ("03 00C8 0000", "83 03"),  # counts and lengths
        ("03 00C8 007E", "83 03"),
        ("03 00C8", "83 03"),
        ("10 0066 0001 04 0001", "90 03"),
        ("10 0066 0000 00", "90 03"),
        ("10 0066 0001 02 0001 0001", "90 03"),
        ("05 0001 0001", "85 03"),
        ("0F 0000 0009 01 01", "8F 03"),
        ("06 006E 0000", "86 03"),  # watchdog below its range
        ("10 0064 0002 04 7FC00000", "90 03"),  # NaN
        ("10 0064 0002 04 7F800000", "90 03"),  # infinity
        ("10 0064 0002 04 42C80000", "90 03"),  # 100 A
        ("10 0078 0002 04 7FC00000", "90 03"),  # NaN as a limit
        ("10 0067 0002 04 00000002", "90 03"),  # lock-step tick out of order
        ("10 0064 0002 04 40000000", "90 04"),  # 2 A while not in remote mode
        ("05 0001 FF00", "85 04"),  # output on while not in remote mode
    ],
)
async def test_exceptions(pdu: str, answer: str) -> None:
    async with rig() as r:
        before = await r.client.ask("03 0064 0006"), await r.client.ask("03 006E 0017"), await r.client.sample()
        assert await r.client.ask(pdu) == bytes.fromhex(answer)
        after = await r.client.ask("03 0064 0006"), await r.client.ask("03 006E 0017"), await r.client.sample()
        assert before == after, "a refused request left a trace"


async def test_unknown_unit_is_answered_as_a_gateway_does() -> None:
    async with rig() as r:
        assert await r.client.ask("03 0000 0001", unit=9) == bytes.fromhex("83 0B")


async def test_message_with_one_bad_value_is_not_taken_over_at_all() -> None:
    async with rig() as r:
        await switch_on(r.client)
        assert await r.client.command(1.5, tick=1, beat=10) == bytes.fromhex(COMMAND_OK)
        assert await r.client.command(math.nan, tick=2, beat=11) == bytes.fromhex("90 03")
        assert await r.client.command(2.5, tick=3, beat=11) == bytes.fromhex("90 03")
        assert struct.unpack(">2xfHI", await r.client.ask("03 0064 0005")) == (1.5, 10, 1)
        assert (await r.client.sample())["sequence"] == 1


async def test_faults() -> None:
    async with rig() as r:
        c = r.client
        script: list[Action | None] = [SILENCE, None, Action(exception=6), delay(0.05), None, DROP]
        seen: list[Frame] = []

        def on_request(frame: Frame) -> Action | None:
            seen.append(frame)
            return script[len(seen) - 1]

        r.server.on_request = on_request
        c.writer.write(c.frame("06 0066 0001") + c.frame("03 0066 0001"))
        assert await c.answer() == (2, 1, bytes.fromhex("03 02 0000"))  # the first was neither done nor answered
        assert await c.ask("03 0066 0001") == bytes.fromhex("83 06")
        c.writer.write(c.frame("06 0066 0004") + c.frame("03 0066 0001"))
        assert await c.answer() == (5, 1, bytes.fromhex("03 02 0004"))
        assert await c.answer() == (4, 1, bytes.fromhex("06 0066 0004"))  # late
        c.writer.write(c.frame("03 0066 0001"))
        async with asyncio.timeout(PATIENCE_S):
            assert await c.reader.read() == b""
        assert [f.function for f in seen] == [6, 3, 3, 6, 3, 3]
