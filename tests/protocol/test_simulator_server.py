"""The simulated cycler's Modbus TCP server, with frames written by hand and with an independent client."""

import asyncio
import math
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

import pytest

from simulators.bench import SimulatorError, SimulatorSettings, build_device, serve
from simulators.device import MapDevice
from simulators.modbus_server import DROP, SILENCE, Action, Frame, ModbusServer, delay

READ_ALL = "03 00C8 000C"
COMMAND_OK = "10 0064 0005"


class HandClock:
    """A monotonic clock that is moved by hand."""

    def __init__(self) -> None:
        self.time_s = 1000.0

    def __call__(self) -> float:
        return self.time_s


@dataclass
class Client:
    """Raw bytes in and out; counts transactions."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    transaction: int = 0

    def frame(self, pdu: str | bytes, unit: int = 1) -> bytes:
        body = bytes.fromhex(pdu) if isinstance(pdu, str) else pdu
        self.transaction += 1
        return struct.pack(">HHHB", self.transaction, 0, len(body) + 1, unit) + body

    async def answer(self) -> tuple[int, int, bytes]:
        async with asyncio.timeout(5):
            head = await self.reader.readexactly(7)
            transaction, protocol, length, unit = struct.unpack(">HHHB", head)
            assert protocol == 0
            return transaction, unit, await self.reader.readexactly(length - 1)

    async def ask(self, pdu: str | bytes, unit: int = 1) -> bytes:
        self.writer.write(self.frame(pdu, unit))
        transaction, answering_unit, reply = await self.answer()
        assert (transaction, answering_unit) == (self.transaction, unit)
        return reply

    async def command(self, current_A: float, tick: int, beat: int = 1) -> bytes:
        return await self.ask(struct.pack(">BHHBfHI", 16, 100, 5, 10, current_A, beat, tick))

    async def output_on(self) -> bool:
        return bool(int((await self.sample())["status"]) & 1)

    async def sample(self) -> dict[str, float]:
        reply = await self.ask(READ_ALL)
        names = "sequence voltage_V current_A temperature ambient setpoint_A status alarms".split()
        return dict(zip(names, struct.unpack(">2xIffhhfHH", reply), strict=True))


@dataclass
class Rig:
    """A served device, its hand-moved clock and a connected client."""

    device: MapDevice
    server: ModbusServer
    clock: HandClock
    port: int
    client: Client

    async def connect(self) -> Client:
        return Client(*await asyncio.open_connection("127.0.0.1", self.port))


@asynccontextmanager
async def rig(*, lock_step: bool = True, seed: int = 1, speed: float = 1.0) -> AsyncIterator[Rig]:
    clock = HandClock()
    device = build_device(SimulatorSettings(lock_step=lock_step, seed=seed, speed=speed), now=clock)
    server = ModbusServer(device)
    port = await server.start("127.0.0.1", 0)
    client = Client(*await asyncio.open_connection("127.0.0.1", port))
    try:
        yield Rig(device, server, clock, port, client)
    finally:
        client.writer.close()
        await server.close()


async def switch_on(client: Client) -> None:
    assert await client.ask("05 0000 FF00") == bytes.fromhex("05 0000 FF00")
    assert await client.ask("05 0001 FF00") == bytes.fromhex("05 0001 FF00")


async def until(condition: Callable[[], bool], seconds: float = 5.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "condition not met in time"
        await asyncio.sleep(0.002)


# --- framing ------------------------------------------------------------------------------------------------


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
        async with asyncio.timeout(5):
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
        await until(lambda: len(r.server.connections) == 1)
        assert await other.ask("03 0066 0001") == bytes.fromhex("03 02 1234")
        other.writer.close()


# --- function codes -----------------------------------------------------------------------------------------


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


# --- behaviour ----------------------------------------------------------------------------------------------


async def test_lock_step_moves_only_by_ticks() -> None:
    async with rig() as r:
        c = r.client
        assert await c.ask("03 006F 0001") == bytes.fromhex("03 02 0001")
        assert await c.ask("10 0070 0002 04 000F4240") == bytes.fromhex("10 0070 0002")  # 1 s
        await switch_on(c)
        start = await c.sample()
        r.clock.time_s += 1.5
        assert await c.sample() == start
        assert await c.command(2.0, tick=1) == bytes.fromhex(COMMAND_OK)
        one = await c.sample()
        assert (one["sequence"], one["setpoint_A"], one["alarms"]) == (1, 2.0, 0)
        assert one["current_A"] == pytest.approx(2.0, abs=0.01)
        assert one["voltage_V"] > start["voltage_V"] + 0.03
        assert one["status"] == 0b10011
        assert await c.command(2.0, tick=1) == bytes.fromhex(COMMAND_OK)  # a repeat moves nothing
        assert await c.sample() == one
        await c.ask("10 0070 0002 04 000F4240")  # a new period starts the count again
        assert await c.command(2.0, tick=1) == bytes.fromhex(COMMAND_OK)
        assert (await c.sample())["sequence"] == 2


async def play(seed: int) -> list[bytes]:
    async with rig(seed=seed) as r:
        await switch_on(r.client)
        record = []
        for tick in range(1, 200):
            await r.client.command(math.sin(tick) * 5.0, tick=tick, beat=tick)
            r.clock.time_s += 0.001 * (tick % 7)  # the wall clock must not matter
            record.append(await r.client.ask(READ_ALL))
        return record


async def test_lock_step_is_reproducible_to_the_bit() -> None:
    first = await play(5)
    assert await play(5) == first
    assert await play(6) != first


async def test_client_gone_in_lock_step() -> None:
    async with rig() as r:
        await switch_on(r.client)
        await r.client.command(2.0, tick=1)
        r.clock.time_s += 1.9
        assert (await r.client.sample())["alarms"] == 0
        r.clock.time_s += 2.1
        late = await r.client.sample()
        assert late["alarms"] == 1 << 6
        assert not await r.client.output_on()
        assert late["setpoint_A"] == 0.0
        assert await r.client.ask("05 0001 FF00") == bytes.fromhex("85 04")  # latched
        assert await r.client.ask("05 0002 FF00") == bytes.fromhex("05 0002 FF00")
        assert await r.client.ask("05 0001 FF00") == bytes.fromhex("05 0001 FF00")


async def test_watchdog_on_the_wall_clock() -> None:
    async with rig(lock_step=False) as r:
        c = r.client
        await switch_on(c)
        await c.ask("06 006E 01F4")  # 0.5 s
        assert await c.command(2.0, tick=0) == bytes.fromhex(COMMAND_OK)
        for _ in range(5):
            r.clock.time_s += 0.4
            assert await c.output_on()
            await c.ask("06 0066 0001")  # heartbeat alone
        r.clock.time_s += 0.4
        assert (await c.sample())["current_A"] == pytest.approx(2.0, abs=0.01)
        r.clock.time_s += 0.2  # reading alone is no heartbeat
        tripped = await c.sample()
        assert tripped["alarms"] == 1 << 5
        assert tripped["status"] == 0b110
        assert tripped["current_A"] == pytest.approx(0.0, abs=0.01)
        assert await c.command(0.0, tick=1) == bytes.fromhex("90 03")  # no lock-step here


async def test_watchdog_counts_wall_time_at_any_speed() -> None:
    async with rig(lock_step=False, speed=20.0) as r:
        await switch_on(r.client)
        await r.client.ask("06 006E 03E8")  # 1 s
        r.clock.time_s += 0.98
        assert (await r.client.sample())["alarms"] == 0
        await r.client.ask("06 0066 0001")  # heartbeat
        r.clock.time_s += 0.98
        assert (await r.client.sample())["alarms"] == 0
        r.clock.time_s += 0.03
        assert (await r.client.sample())["alarms"] == 1 << 5


async def test_sequence_counts_measurements_on_the_wall_clock() -> None:
    async with rig(lock_step=False) as r:
        first = await r.client.sample()
        assert await r.client.sample() == first
        r.clock.time_s += 0.01
        assert (await r.client.sample())["sequence"] == pytest.approx(first["sequence"] + 10, abs=1)


async def test_device_limit_trips_the_output() -> None:
    async with rig() as r:
        await switch_on(r.client)
        await r.client.ask(struct.pack(">BHHBf", 16, 120, 2, 4, 3.72))
        await r.client.command(3.0, tick=1)
        tripped = await r.client.sample()
        assert tripped["alarms"] == 1
        assert not await r.client.output_on()
        assert tripped["setpoint_A"] == 0.0


async def test_giving_up_remote_switches_off() -> None:
    async with rig() as r:
        await switch_on(r.client)
        await r.client.command(1.0, tick=1)
        await r.client.ask("05 0000 0000")
        assert await r.client.ask("01 0000 0003") == bytes.fromhex("01 01 00")
        assert (await r.client.sample())["setpoint_A"] == 0.0


# --- the seam for faults ------------------------------------------------------------------------------------


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
        async with asyncio.timeout(5):
            assert await c.reader.read() == b""
        assert [f.function for f in seen] == [6, 3, 3, 6, 3, 3]


# --- the whole simulator ------------------------------------------------------------------------------------


async def test_serve_reports_its_address_and_ends_with_the_output_off() -> None:
    addresses: list[str] = []
    task = asyncio.create_task(serve(SimulatorSettings(), addresses.append))
    await until(lambda: bool(addresses))
    assert addresses[0].startswith("modbus-tcp://127.0.0.1:")
    port = int(addresses[0].rsplit(":", 1)[1])
    client = Client(*await asyncio.open_connection("127.0.0.1", port))
    await switch_on(client)
    first = await client.sample()
    await until_moved(client, first["sequence"])
    with pytest.raises(SimulatorError, match=f"127.0.0.1:{port}.*choose another port"):
        await serve(SimulatorSettings(port=port), addresses.append)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    async with asyncio.timeout(5):
        assert await client.reader.read() == b""
    client.writer.close()


async def until_moved(client: Client, sequence: float) -> None:
    deadline = time.monotonic() + 5
    while (await client.sample())["sequence"] == sequence:
        assert time.monotonic() < deadline, "simulated time does not move"


def test_sigterm_ends_cleanly() -> None:
    program = (
        "import asyncio\n"
        "from simulators.bench import SimulatorSettings, serve\n"
        "asyncio.run(serve(SimulatorSettings(), lambda address: print(address, flush=True)))\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("modbus-tcp://")
        os.kill(process.pid, signal.SIGTERM)
        assert process.wait(timeout=10) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"protocol": "carrier-pigeon"}, "choose one of modbus-tcp"),
        ({"speed": 0.0}, "speed is 0.0"),
        ({"port": 70000}, "port is 70000"),
        ({"cell": "lead"}, "unknown cell 'lead'"),
        ({"effects": {"magic": 1.0}}, "unknown effect 'magic'"),
        ({"capacity_Ah": -1.0}, "capacity_Ah is -1"),
        ({"initial_soc": 2.0}, r"must lie in 0\.\.1"),
    ],
)
def test_bad_settings_say_what_is_wrong(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build_device(SimulatorSettings(**options))  # pyright: ignore[reportArgumentType]


# --- an independent client ----------------------------------------------------------------------------------


async def mbpoll(port: int, *arguments: str) -> str:
    process = await asyncio.create_subprocess_exec(
        "mbpoll", "-1", "-0", "-B", "-p", str(port), *arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    output, _ = await asyncio.wait_for(process.communicate(), 10)
    assert process.returncode == 0, output.decode()
    return output.decode()


@pytest.mark.needs_program("mbpoll")
async def test_libmodbus_reads_and_writes_the_simulator() -> None:
    async with rig() as r:
        shown = await mbpoll(r.port, "-t", "4:float", "-r", "2", "-c", "2", "127.0.0.1")
        assert "[2]: \t30" in shown
        assert "[4]: \t6" in shown
        shown = await mbpoll(r.port, "-t", "4:hex", "-r", "0", "-c", "2", "127.0.0.1")
        assert "[0]: \t0x4254" in shown
        await mbpoll(r.port, "-t", "0", "-r", "0", "127.0.0.1", "1", "1")  # remote and output, FC 15
        shown = await mbpoll(r.port, "-t", "0", "-r", "0", "-c", "3", "127.0.0.1")
        assert "[0]: \t1" in shown
        assert "[1]: \t1" in shown
        await mbpoll(r.port, "-t", "4:float", "-r", "100", "127.0.0.1", "2.5")  # FC 16
        await mbpoll(r.port, "-t", "4", "-r", "102", "127.0.0.1", "77")  # FC 6
        await mbpoll(r.port, "-t", "4:int", "-r", "103", "127.0.0.1", "1")
        sample = await r.client.sample()
        assert (sample["sequence"], sample["setpoint_A"]) == (1, 2.5)
        shown = await mbpoll(r.port, "-t", "4:float", "-r", "208", "127.0.0.1")
        assert "[208]: \t2.5" in shown
