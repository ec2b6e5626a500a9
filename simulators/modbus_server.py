"""Modbus TCP in front of a simulated device; frames the byte stream itself.

Several requests in one segment are all answered, in order, and a request may arrive in pieces. Layouts after "MODBUS
Application Protocol Specification V1.1b3" and "MODBUS Messaging on TCP/IP Implementation Guide V1.0b".
"""

import asyncio
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple, cast

from simulators.device import ILLEGAL_VALUE, MapDevice, RefusedError

__all__ = ["DROP", "SILENCE", "Action", "Frame", "ModbusConnection", "ModbusServer", "delay"]

ILLEGAL_FUNCTION = 1
NO_SUCH_UNIT = 0x0B  # "gateway target device failed to respond"
MBAP = struct.Struct(">HHHB")
MAX_LENGTH_FIELD = 254  # unit id and a PDU of at most 253 bytes
MAX_READ, MAX_WRITE, MAX_READ_COILS, MAX_WRITE_COILS, MAX_WRITE_23 = 125, 123, 2000, 1968, 121


class Frame(NamedTuple):
    """One request."""

    transaction_id: int
    unit_id: int
    pdu: bytes

    @property
    def function(self) -> int:
        """The function code."""
        return self.pdu[0]


@dataclass(frozen=True, slots=True)
class Action:
    """What a fault hook wants done with one request.

    Attributes
    ----------
    execute : bool
        Whether the request takes effect.
    reply : bool
        Whether it is answered.
    delay_s : float
        How long the answer is held back; answers to later requests are not.
    exception : int or None
        Answer with this code; the request then has no effect.
    close : bool
        Close the connection instead of answering.
    change : Callable or None
        Makes the answer that is sent from the request and the right answer, both without header or check sum.
    corrupt : bool
        Break the answer's check sum; where there is none (TCP), the header.
    unit_id : int or None
        Answer as if from this unit.
    echo : bool
        The request comes back instead of an answer, and has no effect.
    """

    execute: bool = True
    reply: bool = True
    delay_s: float = 0.0
    exception: int | None = None
    close: bool = False
    change: Callable[[bytes, bytes], bytes] | None = None
    corrupt: bool = False
    unit_id: int | None = None
    echo: bool = False

    def changed(self, request: bytes, answer: bytes) -> bytes:
        """Return the answer that is sent in place of the right one."""
        return answer if self.change is None else self.change(request, answer)


SILENCE = Action(execute=False, reply=False)
DROP = Action(execute=False, reply=False, close=True)
OnRequest = Callable[[Frame], Action | None]


def delay(time_s: float) -> Action:
    """Return an action that executes a request at once and answers late."""
    return Action(delay_s=time_s)


class RequestHandler:
    """Turns a PDU into its answer."""

    def __init__(self, device: MapDevice, unit_id: int | None = None) -> None:
        self._device = device
        self._unit_id = device.map.unit_id if unit_id is None else unit_id
        self._max_read = min(MAX_READ, device.map.max_read_registers)
        handlers: dict[int, Callable[[bytes], bytes]] = {
            1: self._read_coils,
            3: lambda pdu: self._read_registers(pdu, "holding"),
            4: lambda pdu: self._read_registers(pdu, "input"),
            5: self._write_coil,
            6: self._write_register,
            15: self._write_coils,
            16: self._write_registers,
            23: self._read_write,
        }
        self._handlers = {code: h for code, h in handlers.items() if code in device.map.functions}

    def answer(self, unit_id: int, pdu: bytes) -> bytes:
        """Execute a request and return the answer's PDU; refusals become exception answers."""
        if unit_id != self._unit_id:
            return bytes((pdu[0] | 0x80, NO_SUCH_UNIT))
        self._device.heard()
        handler = self._handlers.get(pdu[0])
        if handler is None:
            return bytes((pdu[0] | 0x80, ILLEGAL_FUNCTION))
        try:
            return handler(pdu)
        except RefusedError as error:
            return bytes((pdu[0] | 0x80, error.code))
        except struct.error:
            return bytes((pdu[0] | 0x80, ILLEGAL_VALUE))

    def _read_registers(self, pdu: bytes, space: str) -> bytes:
        _, first, count = struct.unpack(">BHH", pdu)
        _expect(1 <= count <= self._max_read)
        return bytes((pdu[0], 2 * count)) + self._device.read(space, first, count)

    def _write_register(self, pdu: bytes) -> bytes:
        _, first, _ = struct.unpack(">BHH", pdu)
        self._device.write(first, pdu[3:5])
        return pdu

    def _write_registers(self, pdu: bytes) -> bytes:
        _, first, count, size = struct.unpack_from(">BHHB", pdu)
        _expect(1 <= count <= MAX_WRITE and size == 2 * count == len(pdu) - 6)
        self._device.write(first, pdu[6:])
        return pdu[:5]

    def _read_write(self, pdu: bytes) -> bytes:
        _, read_first, read_count, first, count, size = struct.unpack_from(">BHHHHB", pdu)
        _expect(1 <= read_count <= self._max_read and 1 <= count <= MAX_WRITE_23)
        _expect(size == 2 * count == len(pdu) - 10)
        self._device.read("holding", read_first, read_count)  # refused before anything is written
        self._device.write(first, pdu[10:])
        return bytes((23, 2 * read_count)) + self._device.read("holding", read_first, read_count)

    def _read_coils(self, pdu: bytes) -> bytes:
        _, first, count = struct.unpack(">BHH", pdu)
        _expect(1 <= count <= MAX_READ_COILS)
        bits = sum(1 << i for i, on in enumerate(self._device.read_coils(first, count)) if on)
        size = (count + 7) // 8
        return bytes((1, size)) + bits.to_bytes(size, "little")

    def _write_coil(self, pdu: bytes) -> bytes:
        _, address, value = struct.unpack(">BHH", pdu)
        _expect(value in (0, 0xFF00))
        self._device.write_coils(address, [value != 0])
        return pdu

    def _write_coils(self, pdu: bytes) -> bytes:
        _, first, count, size = struct.unpack_from(">BHHB", pdu)
        _expect(1 <= count <= MAX_WRITE_COILS and size == (count + 7) // 8 == len(pdu) - 6)
        bits = int.from_bytes(pdu[6:], "little")
        self._device.write_coils(first, [bool(bits >> i & 1) for i in range(count)])
        return pdu[:5]


def _expect(valid: bool) -> None:
    if not valid:
        raise RefusedError(ILLEGAL_VALUE, "count or length outside what the protocol allows")


class Units:
    """The devices behind one address, by unit identifier.

    Parameters
    ----------
    device : MapDevice
        Answers to its map's unit identifier.
    neighbours : Mapping
        More devices, such as the other channels of one cycler.
    """

    def __init__(self, device: MapDevice, neighbours: Mapping[int, MapDevice]) -> None:
        every = {**neighbours, device.map.unit_id: device}
        self._handlers = {unit: RequestHandler(each, unit) for unit, each in every.items()}

    def __contains__(self, unit_id: int) -> bool:
        """Whether there is such a unit."""
        return unit_id in self._handlers

    def __iter__(self) -> Iterator[int]:
        """Go through the identifiers."""
        return iter(self._handlers)

    def answer(self, unit_id: int, pdu: bytes) -> bytes:
        """Execute a request and return the answer's PDU."""
        handler = self._handlers.get(unit_id)
        return bytes((pdu[0] | 0x80, NO_SUCH_UNIT)) if handler is None else handler.answer(unit_id, pdu)


class ModbusConnection(asyncio.Protocol):
    """One client."""

    def __init__(self, units: Units, server: "ModbusServer") -> None:
        self._units = units
        self._server = server
        self._received = bytearray()
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self._transport = cast(asyncio.Transport, transport)
        self._server.connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection; the device keeps its state."""
        self._transport = None
        self._server.connections.discard(self)

    def close(self) -> None:
        """Close the connection from this side."""
        if self._transport is not None:
            self._transport.close()

    def data_received(self, data: bytes) -> None:
        """Answer every whole request that has arrived."""
        received = self._received
        received += data
        replies: list[bytes] = []
        start = 0
        while len(received) - start >= MBAP.size:
            transaction_id, protocol_id, length, unit_id = MBAP.unpack_from(received, start)
            if protocol_id != 0 or not 2 <= length <= MAX_LENGTH_FIELD:
                self.close()  # no way to find the next frame in such a stream
                return
            end = start + 6 + length
            if len(received) < end:
                break
            frame = Frame(transaction_id, unit_id, bytes(received[start + MBAP.size : end]))
            start = end
            reply = self._reply(frame)
            if reply:
                replies.append(reply)
        del received[:start]
        if replies:
            self._send(b"".join(replies))

    def _reply(self, frame: Frame) -> bytes:
        """Return the answer to send now; empty if there is none, or it is sent later."""
        hook = self._server.on_request
        action = hook(frame) if hook else None
        if action is None:
            return self._encoded(frame, self._units.answer(frame.unit_id, frame.pdu))
        if action.close:
            self.close()
        pdu = b""
        if action.exception is not None:
            pdu = bytes((frame.function | 0x80, action.exception))
        elif action.echo:
            pdu = frame.pdu
        elif action.execute:
            pdu = self._units.answer(frame.unit_id, frame.pdu)
        if not pdu or not action.reply or action.close:
            return b""
        unit_id = frame.unit_id if action.unit_id is None else action.unit_id
        reply = self._encoded(frame._replace(unit_id=unit_id), action.changed(frame.pdu, pdu))
        if action.corrupt:
            reply = reply[:2] + b"\xff\xff" + reply[4:]  # a protocol that is not Modbus
        if action.delay_s > 0.0:
            asyncio.get_running_loop().call_later(action.delay_s, self._send, reply)
            return b""
        return reply

    def _send(self, data: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    @staticmethod
    def _encoded(frame: Frame, pdu: bytes) -> bytes:
        return MBAP.pack(frame.transaction_id, 0, len(pdu) + 1, frame.unit_id) + pdu


class ModbusServer:
    """Listens for any number of clients of one device.

    Parameters
    ----------
    device : MapDevice
    on_request : Callable, optional
        Seam for faults: sees each request first, and returns an `Action`, or None to let it pass. May be set or
        replaced while the server runs.
    neighbours : Mapping, optional
        More devices by unit identifier, such as the other channels of one cycler.
    """

    def __init__(
        self, device: MapDevice, on_request: OnRequest | None = None, neighbours: Mapping[int, MapDevice] | None = None
    ) -> None:
        self.device = device
        self.on_request = on_request
        self.connections: set[ModbusConnection] = set()
        self._units = Units(device, neighbours or {})
        self._server: asyncio.Server | None = None

    async def start(self, host: str, port: int) -> int:
        """Listen, and return the port (the free one that was found where `port` is 0).

        Raises
        ------
        OSError
            If the address cannot be listened on.
        """
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: ModbusConnection(self._units, self), host, port)
        return self._server.sockets[0].getsockname()[1]

    async def close(self) -> None:
        """Stop listening and close all connections."""
        if self._server is None:
            return
        self._server.close()
        for connection in list(self.connections):
            connection.close()
        await self._server.wait_closed()
        self._server = None
