"""A CAN bus as python-can knows it: how it is joined, and every frame of it handed to the event loop.

python-can's asynchronous notifier passes over bus errors; here the bus is read directly, so that bus-off and a lost
adapter end the wait of whoever waits.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable
from typing import Any, TypedDict

from drivers.address import CanAddress
from drivers.python_can import can

FRAMES_AT_ONCE = 256  # then the loop's other callbacks get their turn


class BusArguments(TypedDict, total=False):
    """What `can.Bus` is told, as far as the interface takes it."""

    interface: str
    channel: str
    port: int | None
    hop_limit: int
    fd: bool
    protocol: can.CanProtocol
    bitrate: int
    data_bitrate: int


def bus_arguments(address: CanAddress, fd: bool) -> BusArguments:
    """Arguments of `can.Bus`; traffic by UDP never leaves the machine (hop limit 0)."""
    common: BusArguments = {"interface": address.interface, "channel": address.channel}
    if address.interface == "udp_multicast":
        return {**common, "port": address.port, "hop_limit": 0, "fd": fd}
    if address.interface == "virtual":
        return {**common, "protocol": can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20}
    if address.interface == "socketcan":
        return {**common, "fd": fd}  # its bit rate is set by the system: ip link set can0 type can bitrate ...
    if fd and address.data_bitrate:
        common = {**common, "data_bitrate": address.data_bitrate, "fd": True}
    return {**common, "bitrate": address.bitrate}


class CanReceiver:
    """Hands every frame of a bus to a callback in the event loop, by file descriptor where the bus has one.

    Parameters
    ----------
    bus : can.BusABC
    on_message : Callable
        Gets each frame.
    on_failure : Callable
        Told once that the bus is lost, and why.
    lenient : bool
        What is no frame says nothing of the bus: anybody can send to a UDP group.
    """

    def __init__(
        self,
        bus: can.BusABC,
        on_message: Callable[[can.Message], None],
        on_failure: Callable[[str], None],
        *,
        lenient: bool,
    ) -> None:
        self._bus, self._on_message, self._on_failure = bus, on_message, on_failure
        self._lenient = lenient
        self._loop = asyncio.get_running_loop()
        self._running = True
        self._thread: threading.Thread | None = None
        try:
            self._fd = bus.fileno()
        except (NotImplementedError, can.CanError):
            self._fd = -1
        if self._fd >= 0:
            self._loop.add_reader(self._fd, self._drain)
        else:
            self._thread = threading.Thread(target=self._poll, name="can-receive", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Stop; the bus may then be shut down."""
        self._running = False
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
        elif self._thread is not None:
            self._thread.join(timeout=1.0)

    def _drain(self) -> None:
        for _ in range(FRAMES_AT_ONCE):
            try:
                message = self._bus.recv(0)
            except (can.CanError, OSError) as error:
                if not self._lenient:
                    self._loop.remove_reader(self._fd)
                    self._on_failure(f"the bus is lost: {error}")
                return
            if message is None or not self._running:
                return
            self._on_message(message)

    def _poll(self) -> None:
        while self._running:
            try:
                message = self._bus.recv(0.05)
            except (can.CanError, OSError) as error:
                if self._running:
                    self._tell(self._on_failure, f"the bus is lost: {error}")
                return
            if message is not None and self._running:
                self._tell(self._on_message, message)

    def _tell(self, callback: Callable[[Any], None], value: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
            self._loop.call_soon_threadsafe(callback, value)
