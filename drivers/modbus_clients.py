"""What sends Modbus requests and finds their replies: a socket of our own, or pymodbus on a serial line.

What pymodbus 3.16 needs beyond its documented interface stands here and nowhere else. Either client is used without
retries and without reconnecting: a set-point is never sent twice, and coming back is the owner's decision.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ConnectionException
from serial.rs485 import RS485Settings

from drivers.address import SerialAddress
from drivers.modbus_tcp import TcpClient

CONNECT_TIMEOUT_S = 1.0  # a handshake may take longer than a control period; an answer may not

# Our errors say what pymodbus would log as well; without a handler of its own the log would go to stderr.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

Client = TcpClient | AsyncModbusSerialClient
ClientFactory = Callable[[Callable[[bool], None]], Client]


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


def set_timeout(client: Client, timeout_s: float) -> None:
    """Set how long one answer may take, once the client is connected."""
    if isinstance(client, TcpClient):
        client.timeout_s = timeout_s
    else:
        client.ctx.comm_params.timeout_connect = timeout_s  # pymodbus has one time-out for both


def control_direction(client: Client) -> None:
    """Switch on the line driver's direction control (RS-485), where there is a line.

    Raises
    ------
    OSError, ValueError, serial.SerialException
        If the line driver has none.
    """
    if isinstance(client, AsyncModbusSerialClient):
        client.ctx.transport.sync_serial.rs485_mode = RS485Settings()  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue]


def end_wait(client: Client | None) -> None:
    """End the request that is waiting: the device has closed the connection, which pymodbus alone would sit out."""
    if isinstance(client, AsyncModbusSerialClient) and not client.ctx.response_future.done():
        client.ctx.response_future.set_exception(
            ConnectionException("connection lost: closed by the device, or its answer is no Modbus")
        )
