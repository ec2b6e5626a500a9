"""The simulator's end of a CAN bus: frames in and out, with the faults of a node between."""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass

from simulators.python_can import can

__all__ = ["CanAction", "CanBusSettings", "CanPort", "free_udp_port"]

GROUP = "239.74.163.2"  # administratively scoped; with hop limit 0 nothing of it leaves the machine
BUS_OFF = 0x40
FRAMES_AT_ONCE = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class CanBusSettings:
    """Which bus, and which node on it.

    Attributes
    ----------
    interface : str
        "udp_multicast" crosses processes; "virtual" stays within one; "socketcan" is a real or virtual interface
        of the system.
    channel : str
        Group (udp_multicast), name (virtual), interface (socketcan).
    port : int
        UDP port; 0 takes a free one.
    node : int
    """

    interface: str = "udp_multicast"
    channel: str = GROUP
    port: int = 0
    node: int = 0

    def __post_init__(self) -> None:
        """Check the settings once.

        Raises
        ------
        ValueError
            If the interface is not one that the simulator serves, or a number is impossible.
        """
        if self.interface not in ("udp_multicast", "virtual", "socketcan"):
            raise ValueError(f"CAN interface {self.interface!r}; choose udp_multicast, virtual or socketcan")
        if not 0 <= self.port <= 65535 or self.node < 0:
            raise ValueError(f"UDP port {self.port} or node {self.node} is impossible")


@dataclass(frozen=True, slots=True)
class CanAction:
    """What a fault hook wants done with a frame that has come in.

    Attributes
    ----------
    execute, reply : bool
        Whether it takes effect; whether it is answered.
    delay_s : float
        How long the answer is held back.
    change : Callable or None
        Makes the data that is sent of the message's name and its right data; None leaves that message out.
    shift : int
        Added to the identifier of the answers.
    bus_off : bool
        The bench's controller goes bus-off instead of hearing an answer.
    refuse : int or None
        Answer with the map's refusal, and this code.
    echo : bool
        The bench's own frame comes back instead of an answer.
    """

    execute: bool = True
    reply: bool = True
    delay_s: float = 0.0
    change: Callable[[str, bytes], bytes | None] | None = None
    shift: int = 0
    bus_off: bool = False
    refuse: int | None = None
    echo: bool = False


class CanPort:
    """Joins a bus and hands every frame of others to a callback in the event loop.

    Parameters
    ----------
    settings : CanBusSettings
    fd : bool
        CAN FD.
    on_message : Callable
    """

    def __init__(self, settings: CanBusSettings, fd: bool, on_message: Callable[[can.Message], None]) -> None:
        self._fd = fd
        self._on_message = on_message
        self._loop = asyncio.get_running_loop()
        self._bus = _joined(settings, fd)
        self._open = True
        self._file = -1
        with contextlib.suppress(NotImplementedError, can.CanError):
            self._file = self._bus.fileno()
        if self._file >= 0:
            self._loop.add_reader(self._file, self._drain)
        else:
            self._thread = threading.Thread(target=self._poll, name="can-simulator", daemon=True)
            self._thread.start()

    def send(self, identifier: int, data: bytes, *, extended: bool) -> None:
        """Send one frame; a bus that takes none is a bus without this node."""
        message = can.Message(arbitration_id=identifier, data=data, is_extended_id=extended, is_fd=self._fd)
        with contextlib.suppress(can.CanError, OSError):
            self._bus.send(message)

    def send_bus_off(self) -> None:
        """Send what a controller tells its computer when it goes bus-off."""
        message = can.Message(arbitration_id=BUS_OFF, is_error_frame=True, is_extended_id=False, data=bytes(8))
        with contextlib.suppress(can.CanError, OSError):
            self._bus.send(message)

    def close(self) -> None:
        """Leave the bus."""
        if not self._open:
            return
        self._open = False
        if self._file >= 0:
            self._loop.remove_reader(self._file)
        else:
            self._thread.join(timeout=1.0)
        self._bus.shutdown()

    def _drain(self) -> None:
        for _ in range(FRAMES_AT_ONCE):
            try:
                message = self._bus.recv(0)
            except (can.CanError, OSError):
                return  # not a frame
            if message is None or not self._open:
                return
            self._on_message(message)

    def _poll(self) -> None:
        while self._open:
            message = self._bus.recv(0.05)
            if message is not None and self._open:
                with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
                    self._loop.call_soon_threadsafe(self._on_message, message)


def free_udp_port() -> int:
    """Return a port that no socket of this machine listens on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


def _joined(settings: CanBusSettings, fd: bool) -> can.BusABC:
    interface, channel = settings.interface, settings.channel
    if interface == "udp_multicast":
        return can.Bus(interface=interface, channel=channel, port=settings.port, hop_limit=0, fd=fd)
    if interface == "virtual":
        protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        return can.Bus(interface=interface, channel=channel, protocol=protocol)
    return can.Bus(interface=interface, channel=channel, fd=fd)
