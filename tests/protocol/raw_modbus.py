"""A simulated cycler behind Modbus TCP, and a client that sends frames written by hand."""

import asyncio
import struct
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from simulators.bench import SimulatorSettings, build_device
from simulators.device import MapDevice
from simulators.modbus_server import ModbusServer
from tests.patience import PATIENCE_S

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
        async with asyncio.timeout(PATIENCE_S):
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


async def until_moved(client: Client, sequence: float) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while (await client.sample())["sequence"] == sequence:
        assert time.monotonic() < deadline, "simulated time does not move"
