"""One node on a CAN bus: a frame out, its answers in, and an error of the `CyclerError` tree where they stay away.

Nothing is sent periodically: a sender that outlives a hung loop would keep a device's watchdog quiet.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Collection, Iterator, Mapping

from drivers.address import CanAddress
from drivers.can_bus import CanReceiver, bus_arguments
from drivers.can_identifiers import CanIdentifiers
from drivers.can_inbox import Accept, Awaited, CanInbox, ViewOf
from drivers.can_log import TrafficLog
from drivers.errors import CyclerConnectionError, CyclerProtocolError, CyclerTimeoutError
from drivers.python_can import can

SEND_TIMEOUT_S = 0.01


class CanLink:
    """The bench's end.

    Parameters
    ----------
    address : CanAddress
    identifiers : CanIdentifiers
        Of the node's messages.
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
        identifiers: CanIdentifiers,
        *,
        fd: bool,
        min_gap_s: float,
        timeout_s: float,
        silence_s: float,
        view_of: ViewOf = lambda name, data: name,
    ) -> None:
        self.address = str(address)
        self.node = address.node
        self._where = address
        self._identifiers, self._view_of, self._fd = identifiers, view_of, fd
        self._min_gap_s, self._timeout_s, self._silence_s = min_gap_s, timeout_s, silence_s
        self._silent_until_s = 0.0
        self._sent_s = 0.0
        self._bus: can.BusABC | None = None
        self._receiver: CanReceiver | None = None
        self._log = TrafficLog(address.log, f"node{address.node}") if address.log else None
        self._inbox = self._empty_inbox()
        self._beside_others = False  # for as long as another sender must not stop this one

    def _empty_inbox(self) -> CanInbox:
        returns_own = self._where.interface == "udp_multicast"  # this bus hands back what was sent
        return CanInbox(self._identifiers, self._view_of, returns_own=returns_own, log=self._log)

    @property
    def is_open(self) -> bool:
        """Whether the bus is there, as far as this side knows."""
        return self._bus is not None and self._inbox.failure is None

    @property
    def newest(self) -> Mapping[str, tuple[float, bytes]]:
        """When each message last came since the bus was joined, and what it said."""
        return self._inbox.newest

    @property
    def error_frames(self) -> int:
        """How many have come since the bus was joined."""
        return self._inbox.error_frames

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
        self._inbox = inbox = self._empty_inbox()
        try:
            self._bus = can.Bus(**bus_arguments(self._where, self._fd))
        except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
            raise CyclerConnectionError(
                f"{self.address}: cannot join the bus: {error}; is the adapter there, set up and free?"
            ) from error
        self._receiver = CanReceiver(self._bus, inbox.received, inbox.failed, lenient=self._where.port is not None)

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
            No answer in time; bus lost or off; another sender uses this bench's identifiers (but `beside_others`).
        """
        bus = self._usable(what)
        if self._min_gap_s and (wait_s := self._sent_s + self._min_gap_s - time.monotonic()) > 0:
            await asyncio.sleep(wait_s)
        awaited = self._inbox.wait_for(replies, accept, refusals)
        try:
            self._send(bus, name, data, what)
            await self._answered(awaited, what)
        finally:
            self._inbox.wait_for_nothing()
        self._usable(what)
        return next((refusal for refusal in refusals if refusal in awaited.missing), None)

    async def _answered(self, awaited: Awaited, what: str) -> None:
        """Wait until everything has come; the bus is left where it has not, so that no late answer meets a question."""
        try:
            if awaited.missing:
                await asyncio.wait_for(awaited.future, self._timeout_s)
        except TimeoutError as error:
            self._abandon()
            missed = ", ".join(f"'{reply}'" for reply in sorted(awaited.missing))
            raise CyclerTimeoutError(
                f"{self.address}: {what}: no answer {missed} within {self._timeout_s:g} s"
                f"{f', {self.error_frames} error frames' if self.error_frames else ''}; bus left"
            ) from error
        except asyncio.CancelledError:
            self._abandon()
            raise

    @contextlib.contextmanager
    def beside_others(self) -> Iterator[None]:
        """Let nothing be held back because another sender was heard; what comes afterwards tells of it.

        Rest is commanded whoever else commands something, and by one who has to find the device first.
        """
        before, self._beside_others = self._beside_others, True
        try:
            yield
        finally:
            self._beside_others = before

    def check(self, what: str) -> None:
        """Raise what the bus has to tell, as `exchange` would."""
        self._usable(what)

    def _abandon(self) -> None:
        self.close()
        self._silent_until_s = time.monotonic() + self._silence_s

    def _usable(self, what: str) -> can.BusABC:
        if self._inbox.failure is not None:
            self.close()
            raise CyclerConnectionError(f"{self.address}: {what}: {self._inbox.failure}")
        if self._inbox.foreign is not None and not self._beside_others:
            raise CyclerProtocolError(f"{self.address}: {what}: {self._inbox.foreign}")
        if self._bus is None:
            raise CyclerConnectionError(f"{self.address}: {what}: not connected")
        return self._bus

    def _send(self, bus: can.BusABC, name: str, data: bytes, what: str) -> None:
        identifier = self._identifiers.sends[name]
        message = can.Message(
            arbitration_id=identifier,
            data=data,
            is_extended_id=self._identifiers.extended,
            is_fd=self._fd,
            check=True,
        )
        self._inbox.sent(identifier, data)
        try:
            bus.send(message, timeout=SEND_TIMEOUT_S)
        except (can.CanError, OSError) as error:
            self.close()
            raise CyclerConnectionError(f"{self.address}: {what}: cannot send: {error}; bus left") from error
        self._sent_s = time.monotonic()
        if self._log is not None:
            message.timestamp, message.is_rx = time.time(), False
            self._log.put(message)
