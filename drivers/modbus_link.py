"""Modbus requests over one connection: every reply checked, every failure one of the `CyclerError` tree.

Over TCP it speaks through `drivers.modbus_tcp`, on a serial line through pymodbus. pymodbus 3.16 returns device
exceptions instead of raising them, checks neither the length of a reply nor that a reply has the function code of its
request, and lets a request that is waiting when the connection drops wait for its time-out; all of that is made good
here. Either is used without retries and without reconnecting: a set-point is never sent twice, and coming back is the
owner's decision.

Reads are not tried again either. A lost packet is TCP's own business, which repairs it within about 0.2 s; an answer
that stays away for the whole time-out is a device that is silent. A second attempt would need a new connection, and
by then the last reading is older than the bench accepts as ground for a set-point, and the device's watchdog about to
trip.

A serial line has no transaction numbers, so the answer to one request can be taken for the answer to the next. After
a time-out, or a reply that does not fit its request, the line therefore stays silent for the worst reply time of the
device (`silence_s`) and what came meanwhile is thrown away; the same before the first request, because whoever had
the line before may have left a request behind.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ConnectionException, ModbusException
from serial import SerialException
from serial.rs485 import RS485Settings

from drivers.address import SerialAddress
from drivers.device_map import Space
from drivers.errors import CyclerConnectionError, CyclerProtocolError, CyclerTimeoutError
from drivers.modbus_tcp import TcpClient

CONNECT_TIMEOUT_S = 1.0  # a handshake may take longer than a control period; an answer may not

# Modbus Application Protocol V1.1b3, section 7; 7 and 23 (0x17) as EA Elektro-Automatik uses them.
EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledged, still working",
    6: "device busy",
    7: "refused by the device (not in remote control?)",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target did not respond",
    23: "device is in local control",
}

# Our errors say what pymodbus would log as well; without a handler of its own the log would go to stderr.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())


Client = TcpClient | AsyncModbusSerialClient
ClientFactory = Callable[[Callable[[bool], None]], Client]
SLEEP_SLACK_S = 0.001  # the event loop rounds waits up to whole milliseconds


def tcp_client_factory(host: str, port: int) -> ClientFactory:
    """Make clients for Modbus TCP; the argument of each is told of connects and disconnects."""
    return lambda on_change: TcpClient(host, port, CONNECT_TIMEOUT_S, on_change)


def serial_client_factory(address: SerialAddress) -> ClientFactory:
    """Make clients for Modbus RTU on a serial line."""

    def make(on_change: Callable[[bool], None]) -> AsyncModbusSerialClient:
        return AsyncModbusSerialClient(
            address.device,
            baudrate=address.baud,
            parity=address.parity,
            stopbits=address.stopbits,
            handle_local_echo=address.echo,
            timeout=CONNECT_TIMEOUT_S,
            retries=0,
            reconnect_delay=0,
            trace_connect=on_change,
        )

    return make


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
        self._make_client = make_client
        self._unit_id = unit_id
        self._functions = functions
        self._min_gap_s = min_gap_s
        self._timeout_s = timeout_s
        self._silence_s = silence_s
        self._rs485 = rs485
        self._client: Client | None = None
        self._waiting = False
        self._quiet_since_s = 0.0
        self._silent_until_s = time.monotonic() + silence_s

    @property
    def is_open(self) -> bool:
        """Whether there is a connection, as far as this side knows."""
        return self._client is not None and self._client.connected

    async def open(self) -> None:
        """Connect anew.

        Raises
        ------
        CyclerConnectionError
            If nobody answers within `CONNECT_TIMEOUT_S`, or the serial line cannot be had.
        """
        self.close()
        await self._silence()  # opening a serial line then throws away what has come until now
        client = self._make_client(self._on_change)
        if not await client.connect():
            client.close()
            raise CyclerConnectionError(
                f"{self.address}: cannot connect within {CONNECT_TIMEOUT_S:g} s; is the cycler switched on, "
                "reachable and not taken by another program?"
            )
        if isinstance(client, TcpClient):
            client.timeout_s = self._timeout_s
        else:
            client.ctx.comm_params.timeout_connect = self._timeout_s  # pymodbus has one time-out for both
        self._client = client
        if self._rs485:
            self._control_direction(client)

    def close(self) -> None:
        """Close the connection, if there is one."""
        client, self._client = self._client, None
        if client is not None:
            client.close()

    async def read_registers(self, space: Space, first: int, count: int, what: str) -> list[int]:
        """Read registers; exactly `count` of them, or an error."""
        client = self._connected(what)
        function = 3 if space == "holding" else 4
        self._allowed(function, what)
        read = client.read_holding_registers if function == 3 else client.read_input_registers
        reply = await self._exchange(
            client, function, "reading", what, lambda: read(first, count=count, device_id=self._unit_id)
        )
        return self._counted(list(reply.registers), count, what)

    async def write_registers(self, first: int, values: Sequence[int], what: str) -> None:
        """Write consecutive registers in one message.

        One register goes by function 6 where the device has it, because the reply then repeats the value.
        """
        client = self._connected(what)
        if len(values) == 1 and 6 in self._functions:
            reply = await self._exchange(
                client,
                6,
                "writing",
                what,
                lambda: client.write_register(first, values[0], device_id=self._unit_id),
            )
            self._echoed((first, [*values]), (reply.address, list(reply.registers)), what)
            return
        self._allowed(16, what)
        reply = await self._exchange(
            client,
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
        client = self._connected(what)
        self._allowed(23, what)
        reply = await self._exchange(
            client,
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
        client = self._connected(what)
        if 5 in self._functions:
            reply = await self._exchange(
                client, 5, "writing", what, lambda: client.write_coil(address, value, device_id=self._unit_id)
            )
            self._echoed((address, value), (reply.address, bool(reply.bits and reply.bits[0])), what)
            return
        self._allowed(15, what)
        reply = await self._exchange(
            client, 15, "writing", what, lambda: client.write_coils(address, [value], device_id=self._unit_id)
        )
        self._echoed((address, 1), (reply.address, reply.count), what)

    async def _exchange(
        self,
        client: Client,
        function: int,
        doing: str,
        what: str,
        send: Callable[[], Awaitable[Any]],
    ) -> Any:
        """Send one request and return its checked reply."""
        if self._min_gap_s:
            await _sleep_until(self._quiet_since_s + self._min_gap_s)
        self._waiting = True
        try:
            reply = await send()
        except ConnectionException as error:
            self.close()
            raise CyclerConnectionError(f"{self.address}: {doing} {what}: {error}") from error
        except asyncio.CancelledError:
            self._mistrust()  # the answer is still to come
            raise
        except ModbusException as error:
            # Closed, because a late answer must not meet a later request.
            self.close()
            self._mistrust()
            raise CyclerTimeoutError(
                f"{self.address}: {doing} {what}: no answer within {self._timeout_s:g} s; connection closed"
            ) from error
        finally:
            self._waiting = False
            if self._min_gap_s:
                self._quiet_since_s = time.monotonic()
        if reply.function_code == function:
            return reply
        if reply.function_code == function | 0x80:
            reason = EXCEPTIONS.get(reply.exception_code, "unknown")
            raise CyclerProtocolError(
                f"{self.address}: {doing} {what}: device answers exception {reply.exception_code} ({reason})"
            )
        self.close()
        self._mistrust()
        raise CyclerProtocolError(
            f"{self.address}: {doing} {what}: reply has function {reply.function_code}, request had {function}"
        )

    def _counted(self, registers: list[int], count: int, what: str) -> list[int]:
        if len(registers) != count:
            self._mistrust()
            raise CyclerProtocolError(
                f"{self.address}: reading {what}: {len(registers)} registers came back, {count} were asked for"
            )
        return registers

    async def _silence(self) -> None:
        """Wait until no answer to an earlier request can be on its way."""
        if self._silence_s:
            await asyncio.sleep(self._silent_until_s - time.monotonic())

    def _mistrust(self) -> None:
        """Close a serial line on which an answer may come that belongs to an earlier request."""
        if self._silence_s:
            self.close()
            self._silent_until_s = time.monotonic() + self._silence_s

    def _control_direction(self, client: Client) -> None:
        if isinstance(client, TcpClient):
            return
        try:
            client.ctx.transport.sync_serial.rs485_mode = RS485Settings()  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue]
        except (OSError, ValueError, SerialException) as error:
            self.close()
            raise CyclerConnectionError(
                f"{self.address}: the line driver takes no RS-485 direction control ({error}); "
                "leave rs485 out if the adapter switches by itself"
            ) from error

    def _connected(self, what: str) -> Client:
        if self._client is None or not self._client.connected:
            raise CyclerConnectionError(f"{self.address}: {what}: not connected")
        return self._client

    def _allowed(self, function: int, what: str) -> None:
        if function not in self._functions:
            raise CyclerProtocolError(f"{self.address}: {what}: the map does not allow function {function}")

    def _echoed(self, sent: object, echoed: object, what: str) -> None:
        if sent != echoed:
            self._mistrust()
            raise CyclerProtocolError(f"{self.address}: writing {what}: sent {sent}, the reply repeats {echoed}")

    def _on_change(self, connected: bool) -> None:
        """End the request that is waiting as soon as the device has closed the connection."""
        client = self._client
        if connected or not isinstance(client, AsyncModbusSerialClient) or not self._waiting:
            return
        if not client.ctx.response_future.done():
            client.ctx.response_future.set_exception(
                ConnectionException("connection lost: closed by the device, or its answer is no Modbus")
            )


async def _sleep_until(time_s: float) -> None:
    """Sleep until a monotonic time, to better than the event loop's millisecond."""
    left_s = time_s - time.monotonic()
    if left_s > SLEEP_SLACK_S:
        await asyncio.sleep(left_s - SLEEP_SLACK_S)
    while time.monotonic() < time_s:
        await asyncio.sleep(0)
