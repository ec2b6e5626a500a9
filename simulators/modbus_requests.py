"""Modbus requests executed: a PDU in, the answer's PDU out, whatever frames them on the wire.

Layouts after "MODBUS Application Protocol Specification V1.1b3".
"""

import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Protocol

from drivers.register_map import DeviceMap
from simulators.modbus_refusals import ILLEGAL_FUNCTION, ILLEGAL_VALUE, NO_SUCH_UNIT, RefusedError

__all__ = ["Served", "Units"]

MAX_READ, MAX_WRITE, MAX_READ_COILS, MAX_WRITE_COILS, MAX_WRITE_23 = 125, 123, 2000, 1968, 121


class Served(Protocol):
    """What stands behind the requests: registers and coils; each call may raise `RefusedError`."""

    @property
    def map(self) -> DeviceMap:
        """Its device map."""
        ...

    def heard(self) -> None:
        """Catch up before a message is answered."""
        ...

    def read(self, space: str, first: int, count: int) -> bytes:
        """Return the bytes of registers."""
        ...

    def write(self, first: int, data: bytes) -> None:
        """Write holding registers."""
        ...

    def read_coils(self, first: int, count: int) -> list[bool]:
        """Return coils."""
        ...

    def write_coils(self, first: int, values: list[bool]) -> None:
        """Write coils."""
        ...


class RequestHandler:
    """Turns a PDU into its answer."""

    def __init__(self, device: Served, unit_id: int | None = None) -> None:
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
    device : Served
        Answers to its map's unit identifier.
    neighbours : Mapping
        More devices, such as the other channels of one cycler.
    """

    def __init__(self, device: Served, neighbours: Mapping[int, Served]) -> None:
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
