"""Modbus requests to one device: which function carries what, and what the reply must say.

Reads are not tried again. A lost packet is TCP's own business, which repairs it within about 0.2 s; an answer that
stays away for the whole time-out is a device that is silent. A second attempt would need a new connection, and by
then the last reading is older than the bench accepts as ground for a set-point, and the device's watchdog about to
trip. pymodbus does not check the length of a reply; that is made good here.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.device_map import Space
from drivers.errors import CyclerProtocolError
from drivers.modbus_clients import ClientFactory
from drivers.modbus_connection import ModbusConnection

_SHORT_GAP_S = 0.002


class ModbusLink:
    """One connection to one Modbus device.

    Parameters
    ----------
    address : str
        For messages, such as ``modbus-tcp://127.0.0.1:502``.
    make_client : ClientFactory
        Makes a fresh client for each connection, so that nothing is left over from the one before.
    unit_id : int
        Modbus unit identifier.
    functions : frozenset of int
        Function codes that the device allows; no other is sent.
    min_gap_s : float
        Silence that the device needs between two messages, in s.
    timeout_s : float
        How long an answer may take, in s. After a time-out the connection is closed.
    silence_s : float
        Worst reply time of the device, in s, where replies carry no transaction number (a serial line); else 0.
    rs485 : bool
        Switch the line driver's direction control on.
    """

    def __init__(
        self,
        address: str,
        make_client: ClientFactory,
        *,
        unit_id: int,
        functions: frozenset[int],
        min_gap_s: float,
        timeout_s: float,
        silence_s: float = 0.0,
        rs485: bool = False,
    ) -> None:
        self.address = address
        self._connection = ModbusConnection(
            address, make_client, min_gap_s=min_gap_s, timeout_s=timeout_s, silence_s=silence_s, rs485=rs485
        )
        self._quick = silence_s == 0.0 and min_gap_s <= _SHORT_GAP_S
        self._unit_id = unit_id
        self._functions = functions

    @property
    def is_open(self) -> bool:
        """Whether there is a connection, as far as this side knows."""
        return self._connection.is_open

    @property
    def quick(self) -> bool:
        """Whether a message more costs next to nothing: no serial line, no silence between messages."""
        return self._quick

    async def open(self) -> None:
        """Connect anew; see `ModbusConnection.open`."""
        await self._connection.open()

    def close(self) -> None:
        """Close the connection, if there is one."""
        self._connection.close()

    async def read_registers(self, space: Space, first: int, count: int, what: str) -> list[int]:
        """Read registers; exactly `count` of them, or an error."""
        client = self._connection.client(what)
        function = 3 if space == "holding" else 4
        self._allowed(function, what)
        read = client.read_holding_registers if function == 3 else client.read_input_registers
        reply = await self._connection.exchange(
            function, "reading", what, lambda: read(first, count=count, device_id=self._unit_id)
        )
        return self._counted(list(reply.registers), count, what)

    async def write_registers(self, first: int, values: Sequence[int], what: str) -> None:
        """Write consecutive registers in one message.

        One register goes by function 6 where the device has it, because the reply then repeats the value.
        """
        client = self._connection.client(what)
        if len(values) == 1 and 6 in self._functions:
            reply = await self._connection.exchange(
                6,
                "writing",
                what,
                lambda: client.write_register(first, values[0], device_id=self._unit_id),
            )
            self._echoed((first, [*values]), (reply.address, list(reply.registers)), what)
            return
        self._allowed(16, what)
        reply = await self._connection.exchange(
            16,
            "writing",
            what,
            lambda: client.write_registers(first, list(values), device_id=self._unit_id),
        )
        self._echoed((first, len(values)), (reply.address, reply.count), what)

    async def write_then_read(
        self, first: int, values: Sequence[int], read_first: int, read_count: int, what: str
    ) -> list[int]:
        """Write holding registers, then read some, in one message (function 23); exactly `read_count`, or an error."""
        client = self._connection.client(what)
        self._allowed(23, what)
        reply = await self._connection.exchange(
            23,
            "writing",
            what,
            lambda: client.readwrite_registers(
                read_address=read_first,
                read_count=read_count,
                write_address=first,
                values=list(values),
                device_id=self._unit_id,
            ),
        )
        return self._counted(list(reply.registers), read_count, what)

    async def write_coil(self, address: int, value: bool, what: str) -> None:
        """Write one coil by function 5 (the reply must repeat it), or 15 where the device has no 5."""
        client = self._connection.client(what)
        if 5 in self._functions:
            reply = await self._connection.exchange(
                5, "writing", what, lambda: client.write_coil(address, value, device_id=self._unit_id)
            )
            self._echoed((address, value), (reply.address, bool(reply.bits and reply.bits[0])), what)
            return
        self._allowed(15, what)
        reply = await self._connection.exchange(
            15, "writing", what, lambda: client.write_coils(address, [value], device_id=self._unit_id)
        )
        self._echoed((address, 1), (reply.address, reply.count), what)

    def _counted(self, registers: list[int], count: int, what: str) -> list[int]:
        if len(registers) != count:
            self._connection.mistrust()
            raise CyclerProtocolError(
                f"{self.address}: reading {what}: {len(registers)} registers came back, {count} were asked for"
            )
        return registers

    def _allowed(self, function: int, what: str) -> None:
        if function not in self._functions:
            raise CyclerProtocolError(f"{self.address}: {what}: the map does not allow function {function}")

    def _echoed(self, sent: object, echoed: object, what: str) -> None:
        if sent != echoed:
            self._connection.mistrust()
            raise CyclerProtocolError(f"{self.address}: writing {what}: sent {sent}, the reply repeats {echoed}")
