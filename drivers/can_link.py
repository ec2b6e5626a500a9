"""One node on a CAN bus: frames out, the newest frame of each kind in, and every way a bus can fail.

python-can's asynchronous notifier passes over bus errors; here the bus is read directly, so that bus-off and a lost
adapter end the wait of whoever waits. Nothing is sent periodically: a sender that outlives a hung loop would keep a
device's watchdog quiet.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping
from typing import Any

import can

from drivers.address import CanAddress
from drivers.can_log import TrafficLog
from drivers.errors import CyclerConnectionError, CyclerProtocolError, CyclerTimeoutError

BUS_OFF = 0x40  # CAN_ERR_BUSOFF of linux/can/error.h, in the identifier of an error frame
STANDARD_IDS, EXTENDED_IDS = 0x7FF, 0x1FFFFFFF
SENT_REMEMBERED = 256
SEND_TIMEOUT_S = 0.01
FRAMES_AT_ONCE = 256  # then the loop's other callbacks get their turn
Accept = Callable[[str, bytes], bool]
ViewOf = Callable[[str, bytes], str]


class CanLink:
    """The bench's end.

    Parameters
    ----------
    address : CanAddress
    sends, receives : mapping of str to int
        Identifiers of node 0 by message name, for the messages of each direction.
    node_step : int
        Added to identifiers per node number.
    fd : bool
        Frames are CAN FD.
    min_gap_s, timeout_s, silence_s : float
        Between two frames sent; for one answer; with nothing outstanding before the bus is used again after a time-out.
    view_of : Callable
        Finer name of a frame whose identifier stands for several.
    """

    def __init__(
        self,
        address: CanAddress,
        *,
        sends: Mapping[str, int],
        receives: Mapping[str, int],
        node_step: int,
        fd: bool,
        min_gap_s: float,
        timeout_s: float,
        silence_s: float,
        view_of: ViewOf = lambda name, data: name,
    ) -> None:
        self._view_of = view_of
        self.address = str(address)
        self.node = address.node
        self._where = address
        shift = node_step * address.node
        self._ids = {name: identifier + shift for name, identifier in sends.items()}
        self._names = {identifier + shift: name for name, identifier in receives.items()}
        self._own = frozenset(self._ids.values())
        self._returns_own = address.interface == "udp_multicast"  # this bus hands back what was sent
        highest = max([*self._ids.values(), *self._names], default=0)
        plain = max([*sends.values(), *receives.values()], default=0) <= STANDARD_IDS
        if highest > (STANDARD_IDS if plain else EXTENDED_IDS):
            raise CyclerConnectionError(
                f"{self.address}: node {address.node} needs identifier 0x{highest:X}; too large"
            )
        self._extended = not plain
        self._fd = fd
        self._min_gap_s, self._timeout_s, self._silence_s = min_gap_s, timeout_s, silence_s
        self._silent_until_s = 0.0
        self._sent_s = 0.0
        self._bus: can.BusABC | None = None
        self._receiver: _Receiver | None = None
        self._log = TrafficLog(address.log, f"node{address.node}") if address.log else None
        self._reset()

    def _reset(self) -> None:
        self.newest: dict[str, tuple[float, bytes]] = {}  # when it came, and what it said
        self.counts: Counter[str] = Counter()
        self.error_frames = 0
        self._sent: deque[tuple[int, bytes]] = deque(maxlen=SENT_REMEMBERED)
        self._failure: str | None = None
        self._foreign: str | None = None
        self._awaited: tuple[set[str], Accept, asyncio.Future[None], frozenset[str]] | None = None

    @property
    def is_open(self) -> bool:
        """Whether the bus is there, as far as this side knows."""
        return self._bus is not None and self._failure is None

    async def open(self) -> None:
        """Join the bus anew.

        Raises
        ------
        CyclerConnectionError
            If it cannot be joined.
        """
        self.close()
        if (wait_s := self._silent_until_s - time.monotonic()) > 0:
            await asyncio.sleep(wait_s)
        self._reset()
        try:
            self._bus = can.Bus(**_bus_arguments(self._where, self._fd))
        except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
            raise CyclerConnectionError(
                f"{self.address}: cannot join the bus: {error}; is the adapter there, set up and free?"
            ) from error
        self._receiver = _Receiver(self._bus, self._received, self._failed, lenient=self._where.port is not None)

    def close(self) -> None:
        """Leave the bus, if joined."""
        receiver, self._receiver = self._receiver, None
        bus, self._bus = self._bus, None
        if receiver is not None:
            receiver.close()
        if bus is not None:
            with contextlib.suppress(can.CanError, OSError):
                bus.shutdown()

    def start_log(self) -> None:
        """Begin a file of the traffic, where the address asks for one."""
        if self._log is not None:
            self._log.start()

    def stop_log(self) -> None:
        """End the file of the traffic."""
        if self._log is not None:
            self._log.stop()

    async def exchange(
        self,
        name: str,
        data: bytes,
        replies: Collection[str],
        what: str,
        accept: Accept = lambda name, data: True,
        refusals: Collection[str] = (),
    ) -> str | None:
        """Send a frame and wait for its answers.

        Parameters
        ----------
        name, data : str, bytes
            The frame.
        replies : collection of str
            Messages that must all come, after sending; `accept` says whether a frame is the right one.
        what : str
            For messages.
        refusals : collection of str
            Messages that end the wait instead.

        Returns
        -------
        str or None
            The refusal that came, None if all is well. The frames are in `newest`.

        Raises
        ------
        CyclerTimeoutError, CyclerConnectionError, CyclerProtocolError
            No answer in time; bus lost or off; another sender uses this bench's identifiers.
        """
        bus = self._usable(what)
        if self._min_gap_s and (wait_s := self._sent_s + self._min_gap_s - time.monotonic()) > 0:
            await asyncio.sleep(wait_s)
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        missing = set(replies)
        self._awaited = missing, accept, future, frozenset(refusals)
        try:
            self._send(bus, name, data, what)
            if missing:
                await asyncio.wait_for(future, self._timeout_s)
        except TimeoutError as error:
            self._abandon()
            missed = ", ".join(f"'{reply}'" for reply in sorted(missing))
            raise CyclerTimeoutError(
                f"{self.address}: {what}: no answer {missed} within {self._timeout_s:g} s"
                f"{f', {self.error_frames} error frames' if self.error_frames else ''}; bus left"
            ) from error
        except asyncio.CancelledError:
            self._abandon()
            raise
        finally:
            self._awaited = None
        self._usable(what)
        return next((refusal for refusal in refusals if refusal in missing), None)

    def check(self, what: str) -> None:
        """Raise what the bus has to tell, as `exchange` would."""
        self._usable(what)

    def _abandon(self) -> None:
        self.close()
        self._silent_until_s = time.monotonic() + self._silence_s

    def _usable(self, what: str) -> can.BusABC:
        if self._failure is not None:
            reason = self._failure
            self.close()
            raise CyclerConnectionError(f"{self.address}: {what}: {reason}")
        if self._foreign is not None:
            raise CyclerProtocolError(f"{self.address}: {what}: {self._foreign}")
        if self._bus is None:
            raise CyclerConnectionError(f"{self.address}: {what}: not connected")
        return self._bus

    def _send(self, bus: can.BusABC, name: str, data: bytes, what: str) -> None:
        identifier = self._ids[name]
        message = can.Message(
            arbitration_id=identifier, data=data, is_extended_id=self._extended, is_fd=self._fd, check=True
        )
        self._sent.append((identifier, data))
        try:
            bus.send(message, timeout=SEND_TIMEOUT_S)
        except (can.CanError, OSError) as error:
            self.close()
            raise CyclerConnectionError(f"{self.address}: {what}: cannot send: {error}; bus left") from error
        self._sent_s = time.monotonic()
        if self._log is not None:
            message.timestamp, message.is_rx = time.time(), False
            self._log.put(message)

    # --- what comes in -------------------------------------------------------------------------------------

    def _received(self, message: can.Message) -> None:
        if message.is_error_frame:
            self._error_frame(message)
            return
        identifier, data = message.arbitration_id, bytes(message.data)
        name = self._names.get(identifier)
        if identifier in self._own and message.is_extended_id == self._extended:
            if self._is_own(identifier, data, shared=name is not None) or name is None:
                return
        if name is None or message.is_extended_id != self._extended or message.is_remote_frame:
            return  # somebody else's business on a shared bus
        if self._log is not None:
            self._log.put(message)
        try:
            name = self._view_of(name, data)
        except CyclerProtocolError:
            return  # too short to be anything that is waited for
        awaited = self._awaited
        if awaited is None:
            self._keep(name, data)
            return
        missing, accept, future, refusals = awaited
        if name in refusals:
            self._keep(name, data)
            missing.clear()
            missing.add(name)
            _done(future)
        elif name in missing:
            if not accept(name, data):
                return  # the answer to an earlier question
            self._keep(name, data)
            missing.discard(name)
            if not missing:
                _done(future)
        else:
            self._keep(name, data)

    def _keep(self, name: str, data: bytes) -> None:
        self.newest[name] = time.monotonic(), data
        self.counts[name] += 1

    def _is_own(self, identifier: int, data: bytes, *, shared: bool) -> bool:
        """Whether a frame is one of ours that came back; one that is not has another sender.

        On a bus that does not return what was sent, a frame under a shared identifier is the device's answer, even
        if it is the same to the bit.
        """
        sent = (identifier, data) in self._sent
        if sent and (self._returns_own or not shared):
            self._sent.remove((identifier, data))
            return True
        if not shared:
            self._foreign = (
                f"another sender uses identifier 0x{identifier:X} of this bench (data {data.hex(' ')}); "
                "two masters must not steer one cycler"
            )
        return False

    def _error_frame(self, message: can.Message) -> None:
        self.error_frames += 1
        if self._log is not None:
            self._log.put(message)
        if message.arbitration_id & BUS_OFF:
            self._failed("the controller is bus-off: check wiring, termination and bit rate")

    def _failed(self, reason: str) -> None:
        self._failure = self._failure or reason
        if self._awaited is not None:
            _done(self._awaited[2])


class _Receiver:
    """Hands every frame of a bus to a callback in the event loop, by file descriptor where the bus has one."""

    def __init__(
        self,
        bus: can.BusABC,
        on_message: Callable[[can.Message], None],
        on_failure: Callable[[str], None],
        *,
        lenient: bool,
    ) -> None:
        self._bus, self._on_message, self._on_failure = bus, on_message, on_failure
        self._lenient = lenient  # anybody can send to a UDP group; what is no frame says nothing of the bus
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


def _done(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)


def _bus_arguments(address: CanAddress, fd: bool) -> dict[str, Any]:
    """Arguments of `can.Bus`; traffic by UDP never leaves the machine (hop limit 0)."""
    common: dict[str, Any] = {"interface": address.interface, "channel": address.channel}
    if address.interface == "udp_multicast":
        return common | {"port": address.port, "hop_limit": 0, "fd": fd}
    if address.interface == "virtual":
        return common | {"protocol": can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20}
    if address.interface == "socketcan":
        return common | {"fd": fd}  # its bit rate is set by the system: ip link set can0 type can bitrate ...
    if fd and address.data_bitrate:
        common |= {"data_bitrate": address.data_bitrate, "fd": True}
    return common | {"bitrate": address.bitrate}
