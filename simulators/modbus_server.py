"""Modbus TCP in front of a simulated device; frames the byte stream itself.

Several requests in one segment are all answered, in order, and a request may arrive in pieces. Layouts after "MODBUS
Messaging on TCP/IP Implementation Guide V1.0b".
"""

import asyncio
import struct
from collections.abc import Mapping
from typing import cast

from simulators.modbus_actions import Frame, OnRequest
from simulators.modbus_requests import Served, Units

__all__ = ["ModbusConnection", "ModbusServer"]

MBAP = struct.Struct(">HHHB")
MAX_LENGTH_FIELD = 254  # unit id and a PDU of at most 253 bytes


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
        pdu = action.answered(frame, lambda: self._units.answer(frame.unit_id, frame.pdu))
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
    device : Served
    on_request : Callable, optional
        Seam for faults: sees each request first, and returns an `Action`, or None to let it pass. May be set or
        replaced while the server runs.
    neighbours : Mapping, optional
        More devices by unit identifier, such as the other channels of one cycler.
    """

    def __init__(
        self, device: Served, on_request: OnRequest | None = None, neighbours: Mapping[int, Served] | None = None
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
