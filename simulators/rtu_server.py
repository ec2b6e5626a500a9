"""Modbus RTU in front of a simulated device; frames and check sums of its own.

Layouts after "MODBUS over Serial Line Specification and Implementation Guide V1.02". Requests are framed by their
length, a broken one by the silence after it.
"""

import asyncio
import contextlib
from collections.abc import Iterable, Mapping
from functools import partial

from simulators.device import MapDevice
from simulators.modbus_actions import Action, Frame, OnRequest
from simulators.modbus_requests import Units
from simulators.serial_line import SerialLine, SerialSettings

__all__ = ["RtuServer", "crc16"]

SMALLEST = 4  # unit, function, check sum
BROADCAST = 0
# Silence after which half a request is thrown away: 3.5 characters, but a loaded computer hands bytes over late.
SHORTEST_SILENCE_S = 0.02
_FIXED = {1: 8, 2: 8, 3: 8, 4: 8, 5: 8, 6: 8}
_COUNTED = {15: 6, 16: 6, 23: 10}  # where the number of data bytes stands


def crc16(data: bytes) -> bytes:
    """Check sum of a frame, as it stands on the line (polynomial 0xA001, low byte first)."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc.to_bytes(2, "little")


def _table() -> tuple[int, ...]:
    rows = []
    for row in range(256):
        for _ in range(8):
            row = row >> 1 ^ (0xA001 if row & 1 else 0)
        rows.append(row)
    return tuple(rows)


_TABLE = _table()


class RtuServer:
    """Serves one device on a serial line; one request after the other, as a device with one processor does.

    Parameters
    ----------
    device : MapDevice
    settings : SerialSettings
    on_request : Callable, optional
        Seam for faults, as in `simulators.modbus_server.ModbusServer`. Closing the connection means silence here.
    neighbours : Mapping, optional
        More devices on the line, by unit identifier.
    """

    def __init__(
        self,
        device: MapDevice,
        settings: SerialSettings,
        on_request: OnRequest | None = None,
        neighbours: Mapping[int, MapDevice] | None = None,
    ) -> None:
        self.device = device
        self.on_request = on_request
        self._settings = settings
        self._units = Units(device, neighbours or {})
        self._line: SerialLine | None = None
        self._serving: asyncio.Task[None] | None = None

    async def start(self) -> str:
        """Open the line and return the device that clients open.

        Raises
        ------
        OSError
            If the port cannot be opened.
        """
        self._line = SerialLine(self._settings)
        self._serving = asyncio.create_task(self._serve(self._line))
        return self._line.device

    async def close(self) -> None:
        """Stop serving and close the line."""
        if self._serving is not None:
            self._serving.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._serving
        if self._line is not None:
            self._line.close()
        self._serving = self._line = None

    async def _serve(self, line: SerialLine) -> None:
        silence_s = max(SHORTEST_SILENCE_S, 3.5 * self._settings.character_s)
        while True:
            size = _frame_size(line.received)
            if size is None or len(line.received) < size:
                if not await line.wait(silence_s if line.received else None):
                    line.received.clear()
                continue
            adu = bytes(line.received[:size])
            if crc16(adu[:-2]) != adu[-2:]:
                # Where the next frame begins is known only after a silence.
                while await line.wait(silence_s):
                    pass
                line.received.clear()
                continue
            del line.received[:size]
            await self._answer(line, Frame(0, adu[0], adu[1:-2]))

    async def _answer(self, line: SerialLine, frame: Frame) -> None:
        silent = frame.unit_id == BROADCAST and BROADCAST not in self._units  # a message to all
        if frame.unit_id not in self._units and not silent:
            return  # meant for another device on the line
        action = (self.on_request(frame) if self.on_request else None) or Action()
        units = self._units if silent else (frame.unit_id,)
        pdu = action.answered(frame, partial(self._executed, units, frame.pdu))
        if action.delay_s > 0.0:
            await asyncio.sleep(action.delay_s)
        if pdu and action.reply and not action.close and not silent:
            pdu = action.changed(frame.pdu, pdu)
            adu = bytes((action.unit_id if action.unit_id is not None else frame.unit_id,)) + pdu
            check = crc16(adu)
            frame_bytes = adu + (bytes((check[0] ^ 0xFF, check[1])) if action.corrupt else check)
            await line.send(frame_bytes, None if action.delay_s > 0.0 else line.arrived_s)

    def _executed(self, units: Iterable[int], pdu: bytes) -> bytes:
        """Execute a request on some units and return the last one's answer."""
        answer = b""
        for unit in units:
            answer = self._units.answer(unit, pdu)
        return answer


def _frame_size(data: bytearray) -> int | None:
    """Length of the request that begins here; None as long as it cannot be said."""
    if len(data) < SMALLEST:
        return None
    if size := _FIXED.get(data[1]):
        return size
    at = _COUNTED.get(data[1])
    if at is None:
        # An unknown function: the frame is what came in one piece, if its check sum says so.
        return len(data) if crc16(bytes(data[:-2])) == bytes(data[-2:]) else None
    return at + 1 + data[at] + 2 if len(data) > at else None
