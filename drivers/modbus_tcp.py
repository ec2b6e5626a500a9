"""Modbus TCP requests over one socket, without a task, a transport or a retry between them and the wire.

A reply on a local network is there within a fraction of a millisecond, less than the event loop takes to go to sleep
and wake up. So the socket is first looked at for `QUICK_S`; only then is the wait left to the loop. Where that was in
vain (a slow device, or a server in the same loop), the next requests go to the loop at once.

The class has the methods and the replies of pymodbus' client that `drivers.modbus_link` uses, so that a serial line,
which stays with pymodbus, is handled by the same code. Layouts after the MODBUS Application Protocol V1.1b3.
"""

from __future__ import annotations

import asyncio
import select
import socket
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pymodbus.exceptions import ConnectionException, ModbusIOException

QUICK_S = 0.0015
# After so many waits in vain, so many requests go to the loop at once; where it stays in vain, ever more.
VAIN_ATTEMPTS, AGAIN_ATTEMPTS = 20, 3
PAUSE, LONGEST_PAUSE = 100, 1600
MBAP = struct.Struct(">HHHB")
MOST_BYTES = 254  # length field: unit identifier and a PDU of at most 253 bytes
RECEIVE_BYTES = 4096
_NOT_MODBUS = "connection lost: closed by the device, or its answer is no Modbus"


@dataclass(frozen=True, slots=True)
class Reply:
    """What a device answered; the fields that its function has."""

    function_code: int
    exception_code: int = 0
    registers: tuple[int, ...] = ()
    bits: tuple[bool, ...] = ()
    address: int = 0
    count: int = 0


class TcpClient:
    """One connection to one Modbus TCP server; requests do not overlap.

    Parameters
    ----------
    host, port : str, int
    timeout_s : float
        For connecting and, until it is set otherwise, for one answer.
    on_change : Callable
        Told of connects and disconnects.
    """

    def __init__(self, host: str, port: int, timeout_s: float, on_change: Callable[[bool], None]) -> None:
        self._host, self._port = host, port
        self.timeout_s = timeout_s
        self._on_change = on_change
        self._socket: socket.socket | None = None
        self._poll = select.poll()
        self._received = bytearray()
        self._transaction = self._unit = 0
        self._patience, self._pause, self._paused = VAIN_ATTEMPTS, PAUSE, 0

    @property
    def connected(self) -> bool:
        """Whether there is a connection, as far as this side knows."""
        return self._socket is not None

    async def connect(self) -> bool:
        """Connect; return whether that worked in time."""
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(self.timeout_s):
                found = await loop.getaddrinfo(self._host, self._port, type=socket.SOCK_STREAM)
                for family, kind, protocol, _, address in found:
                    if await self._connected_to(socket.socket(family, kind, protocol), address):
                        self._on_change(True)
                        return True
        except (OSError, TimeoutError):
            pass
        return False

    async def _connected_to(self, made: socket.socket, address: object) -> bool:
        made.setblocking(False)
        try:
            await asyncio.get_running_loop().sock_connect(made, address)  # pyright: ignore[reportArgumentType]
        except OSError:
            made.close()
            return False
        except BaseException:
            made.close()
            raise
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket, self._poll = made, select.poll()
        self._poll.register(made, select.POLLIN)
        self._received.clear()
        return True

    def close(self) -> None:
        """Close the connection, if there is one."""
        made, self._socket = self._socket, None
        if made is not None:
            made.close()
            self._on_change(False)

    # --- requests ------------------------------------------------------------------------------------------
    async def read_holding_registers(self, address: int, *, count: int, device_id: int) -> Reply:
        """Function 3."""
        return _registers(await self._ask(device_id, struct.pack(">BHH", 3, address, count)))

    async def read_input_registers(self, address: int, *, count: int, device_id: int) -> Reply:
        """Function 4."""
        return _registers(await self._ask(device_id, struct.pack(">BHH", 4, address, count)))

    async def write_register(self, address: int, value: int, *, device_id: int) -> Reply:
        """Function 6; the reply repeats the value."""
        pdu = await self._ask(device_id, struct.pack(">BHH", 6, address, value))
        return _repeated(pdu, lambda where, value: Reply(pdu[0], address=where, registers=(value,)))

    async def write_registers(self, address: int, values: Sequence[int], *, device_id: int) -> Reply:
        """Function 16."""
        count = len(values)
        pdu = await self._ask(device_id, struct.pack(f">BHHB{count}H", 16, address, count, 2 * count, *values))
        return _repeated(pdu, lambda where, count: Reply(pdu[0], address=where, count=count))

    async def write_coil(self, address: int, value: bool, *, device_id: int) -> Reply:
        """Function 5; the reply repeats the value."""
        pdu = await self._ask(device_id, struct.pack(">BHH", 5, address, 0xFF00 if value else 0))
        return _repeated(pdu, lambda where, value: Reply(pdu[0], address=where, bits=(value == 0xFF00,)))

    async def write_coils(self, address: int, values: Sequence[bool], *, device_id: int) -> Reply:
        """Function 15."""
        size = (len(values) + 7) // 8
        bits = sum(1 << index for index, value in enumerate(values) if value)
        data = struct.pack(">BHHB", 15, address, len(values), size) + bits.to_bytes(size, "little")
        pdu = await self._ask(device_id, data)
        return _repeated(pdu, lambda where, count: Reply(pdu[0], address=where, count=count))

    async def readwrite_registers(
        self, *, read_address: int, read_count: int, write_address: int, values: Sequence[int], device_id: int
    ) -> Reply:
        """Function 23: write first, then read."""
        count = len(values)
        head = (23, read_address, read_count, write_address, count, 2 * count)
        return _registers(await self._ask(device_id, struct.pack(f">BHHHHB{count}H", *head, *values)))

    # --- the wire ------------------------------------------------------------------------------------------
    async def _ask(self, unit: int, pdu: bytes) -> bytes:
        """Send a request and return its answer's PDU; answers to earlier requests are passed over."""
        made = self._socket
        if made is None:
            raise ConnectionException("not connected")
        self._transaction = transaction = self._transaction % 0xFFFF + 1
        self._unit = unit
        try:
            data = MBAP.pack(transaction, 0, len(pdu) + 1, unit) + pdu
            if made.send(data) != len(data):
                raise BlockingIOError("the connection takes no more data")
            if (answer := self._quickly(made, transaction)) is not None:
                return answer
            async with asyncio.timeout(self.timeout_s):
                while (answer := self._next(transaction)) is None:
                    self._take(await asyncio.get_running_loop().sock_recv(made, RECEIVE_BYTES))
            return answer
        except TimeoutError as error:
            raise ModbusIOException("no answer in time") from error
        except OSError as error:
            self.close()
            raise ConnectionException(f"connection lost: {error}") from error

    def _quickly(self, made: socket.socket, transaction: int) -> bytes | None:
        """Look for the answer without leaving it to the event loop."""
        if self._paused:
            self._paused -= 1
            return None
        if not self._poll.poll(1000.0 * QUICK_S):
            self._patience -= 1
            if self._patience <= 0:
                self._paused, self._patience = self._pause, AGAIN_ATTEMPTS
                self._pause = min(2 * self._pause, LONGEST_PAUSE)
            return None
        self._patience, self._pause = VAIN_ATTEMPTS, PAUSE
        self._take(made.recv(RECEIVE_BYTES))
        return self._next(transaction)

    def _take(self, data: bytes) -> None:
        if not data:
            self.close()
            raise ConnectionException(_NOT_MODBUS)
        self._received += data

    def _next(self, transaction: int) -> bytes | None:
        """Return the PDU of the answer to a request, if it is there as a whole."""
        received = self._received
        while len(received) >= MBAP.size:
            number, protocol, length, unit = MBAP.unpack_from(received)
            if protocol != 0 or not 2 <= length <= MOST_BYTES:
                self.close()
                raise ConnectionException(_NOT_MODBUS)
            if len(received) < 6 + length:
                return None
            pdu = bytes(received[MBAP.size : 6 + length])
            del received[: 6 + length]
            if number == transaction and self._unit in (0, unit):  # a device alone may answer 0 with its own number
                return pdu
        return None


def _registers(pdu: bytes) -> Reply:
    if pdu[0] & 0x80:
        return _refused(pdu)
    size = pdu[1] if len(pdu) > 1 else -1
    if size != len(pdu) - 2 or size % 2:
        raise ConnectionException(_NOT_MODBUS)
    return Reply(pdu[0], registers=struct.unpack(f">{size // 2}H", pdu[2:]))


def _repeated(pdu: bytes, make: Callable[[int, int], Reply]) -> Reply:
    if pdu[0] & 0x80:
        return _refused(pdu)
    if len(pdu) != 5:
        raise ConnectionException(_NOT_MODBUS)
    return make(*struct.unpack(">HH", pdu[1:]))


def _refused(pdu: bytes) -> Reply:
    if len(pdu) != 2:
        raise ConnectionException(_NOT_MODBUS)
    return Reply(pdu[0], exception_code=pdu[1])
