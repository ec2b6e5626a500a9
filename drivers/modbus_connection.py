"""One Modbus connection, and one request at a time on it; every failure is one of the `CyclerError` tree.

pymodbus 3.16 returns device exceptions instead of raising them, does not check that a reply has the function code of
its request, and lets a request that is waiting when the connection drops wait for its time-out; all of that is made
good here. No request is repeated and no connection opened again by itself.

A serial line has no transaction numbers, so the answer to one request can be taken for the answer to the next. After
a time-out, or a reply that does not fit its request, the line therefore stays silent for the worst reply time of the
device (`silence_s`) and what came meanwhile is thrown away; the same before the first request, because whoever had
the line before may have left a request behind.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

from pymodbus.exceptions import ConnectionException, ModbusException
from serial import SerialException

from drivers.errors import CyclerConnectionError, CyclerProtocolError, CyclerTimeoutError
from drivers.modbus_clients import (
    CONNECT_TIMEOUT_S,
    Client,
    ClientFactory,
    control_direction,
    end_wait,
    set_timeout,
)

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

SLEEP_SLACK_S = 0.001  # the event loop rounds waits up to whole milliseconds


class ModbusConnection:
    """The connection to one device.

    Parameters
    ----------
    address : str
        For messages, such as ``modbus-tcp://127.0.0.1:502``.
    make_client : ClientFactory
        Makes a fresh client for each connection, so that nothing is left over from the one before.
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
        min_gap_s: float,
        timeout_s: float,
        silence_s: float,
        rs485: bool,
    ) -> None:
        self.address = address
        self._make_client = make_client
        self._min_gap_s, self._timeout_s, self._silence_s = min_gap_s, timeout_s, silence_s
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
                f"{self.address}: cannot connect within {CONNECT_TIMEOUT_S:g} s; is the device switched on, "
                "reachable and not taken by another program?"
            )
        set_timeout(client, self._timeout_s)
        self._client = client
        if self._rs485:
            self._control_direction(client)

    def close(self) -> None:
        """Close the connection, if there is one."""
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def client(self, what: str) -> Client:
        """Return the client to send by.

        Raises
        ------
        CyclerConnectionError
            If there is no connection.
        """
        if self._client is None or not self._client.connected:
            raise CyclerConnectionError(f"{self.address}: {what}: not connected")
        return self._client

    async def exchange(self, function: int, doing: str, what: str, send: Callable[[], Awaitable[Any]]) -> Any:
        """Send one request and return its reply, which has the request's function code.

        Raises
        ------
        CyclerTimeoutError, CyclerConnectionError, CyclerProtocolError
            No reply in time; connection lost; the device answers an exception, or to another function.
        """
        reply = await self._answer(doing, what, send)
        if reply.function_code == function:
            return reply
        if reply.function_code == function | 0x80:
            reason = EXCEPTIONS.get(reply.exception_code, "unknown")
            raise CyclerProtocolError(
                f"{self.address}: {doing} {what}: device answers exception {reply.exception_code} ({reason})"
            )
        self.close()
        self.mistrust()
        raise CyclerProtocolError(
            f"{self.address}: {doing} {what}: reply has function {reply.function_code}, request had {function}"
        )

    async def _answer(self, doing: str, what: str, send: Callable[[], Awaitable[Any]]) -> Any:
        """Send one request and return whatever comes as its reply; where none comes, nothing may come later."""
        if self._min_gap_s:
            await _sleep_until(self._quiet_since_s + self._min_gap_s)
        self._waiting = True
        try:
            return await send()
        except ConnectionException as error:
            self.close()
            raise CyclerConnectionError(f"{self.address}: {doing} {what}: {error}") from error
        except asyncio.CancelledError:
            self.mistrust()  # the answer is still to come
            raise
        except ModbusException as error:
            # Closed, because a late answer must not meet a later request.
            self.close()
            self.mistrust()
            raise CyclerTimeoutError(
                f"{self.address}: {doing} {what}: no answer within {self._timeout_s:g} s; connection closed"
            ) from error
        finally:
            self._waiting = False
            if self._min_gap_s:
                self._quiet_since_s = time.monotonic()

    async def _silence(self) -> None:
        """Wait until no answer to an earlier request can be on its way."""
        if self._silence_s:
            await asyncio.sleep(self._silent_until_s - time.monotonic())

    def mistrust(self) -> None:
        """Close a serial line on which an answer may come that belongs to an earlier request."""
        if self._silence_s:
            self.close()
            self._silent_until_s = time.monotonic() + self._silence_s

    def _control_direction(self, client: Client) -> None:
        try:
            control_direction(client)
        except (OSError, ValueError, SerialException) as error:
            self.close()
            raise CyclerConnectionError(
                f"{self.address}: the line driver takes no RS-485 direction control ({error}); "
                "leave rs485 out if the adapter switches by itself"
            ) from error

    def _on_change(self, connected: bool) -> None:
        """End the request that is waiting as soon as the device has closed the connection."""
        if not connected and self._waiting:
            end_wait(self._client)


async def _sleep_until(time_s: float) -> None:
    """Sleep until a monotonic time, to better than the event loop's millisecond."""
    left_s = time_s - time.monotonic()
    if left_s > SLEEP_SLACK_S:
        await asyncio.sleep(left_s - SLEEP_SLACK_S)
    while time.monotonic() < time_s:
        await asyncio.sleep(0)
