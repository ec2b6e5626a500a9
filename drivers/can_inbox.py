"""What has come in over a CAN bus: the newest frame of each message, the answers waited for, and what went wrong."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass

from drivers.can_identifiers import CanIdentifiers
from drivers.can_log import TrafficLog
from drivers.errors import CyclerProtocolError
from drivers.python_can import can

BUS_OFF = 0x40  # CAN_ERR_BUSOFF of linux/can/error.h, in the identifier of an error frame
SENT_REMEMBERED = 256
Accept = Callable[[str, bytes], bool]
ViewOf = Callable[[str, bytes], str]


@dataclass(frozen=True, slots=True)
class Awaited:
    """Answers that are waited for.

    `missing` holds those that have not come; after a refusal that alone. `future` is done when the wait is over.
    """

    missing: set[str]
    accept: Accept
    refusals: frozenset[str]
    future: asyncio.Future[None]

    def end(self) -> None:
        """End the wait, if it has not ended."""
        if not self.future.done():
            self.future.set_result(None)


class CanInbox:
    """Sorts the frames of one connection; a new connection begins with an empty one.

    Parameters
    ----------
    identifiers : CanIdentifiers
        Of the node's messages.
    view_of : Callable
        Finer name of a frame whose identifier stands for several.
    returns_own : bool
        Whether the bus hands back what was sent.
    log : TrafficLog or None
        Notes what is the bench's business.

    Attributes
    ----------
    newest : dict
        When each message last came (monotonic), and what it said.
    error_frames : int
    failure : str or None
        Why the bus can no longer be used.
    foreign : str or None
        Which other sender uses this bench's identifiers.
    """

    def __init__(
        self, identifiers: CanIdentifiers, view_of: ViewOf, *, returns_own: bool, log: TrafficLog | None
    ) -> None:
        self._identifiers, self._view_of, self._returns_own, self._log = identifiers, view_of, returns_own, log
        self._own = frozenset(identifiers.sends.values())
        self._sent: deque[tuple[int, bytes]] = deque(maxlen=SENT_REMEMBERED)
        self._awaited: Awaited | None = None
        self.newest: dict[str, tuple[float, bytes]] = {}
        self.error_frames = 0
        self.failure: str | None = None
        self.foreign: str | None = None

    def sent(self, identifier: int, data: bytes) -> None:
        """Remember a frame of this bench, to know it again if it comes back."""
        self._sent.append((identifier, data))

    def wait_for(self, replies: Collection[str], accept: Accept, refusals: Collection[str]) -> Awaited:
        """Begin to wait for messages that come from now on; `accept` says whether a frame is the right one."""
        self._awaited = Awaited(set(replies), accept, frozenset(refusals), asyncio.get_running_loop().create_future())
        return self._awaited

    def wait_for_nothing(self) -> None:
        """End the waiting."""
        self._awaited = None

    def failed(self, reason: str) -> None:
        """Take note that the bus is lost, and end the wait; the first reason stays."""
        self.failure = self.failure or reason
        if self._awaited is not None:
            self._awaited.end()

    def received(self, message: can.Message) -> None:
        """Sort one frame."""
        if message.is_error_frame:
            self._error_frame(message)
            return
        name = self._name_of(message)
        if name is None:
            return
        if self._log is not None:
            self._log.put(message)
        data = bytes(message.data)
        try:
            name = self._view_of(name, data)
        except CyclerProtocolError:
            return  # too short to be anything that is waited for
        self._deliver(name, data)

    def _error_frame(self, message: can.Message) -> None:
        self.error_frames += 1
        if self._log is not None:
            self._log.put(message)
        if message.arbitration_id & BUS_OFF:
            self.failed("the controller is bus-off: check wiring, termination and bit rate")

    def _name_of(self, message: can.Message) -> str | None:
        """Name of a frame of the device; None for an own one and for somebody else's business on a shared bus."""
        identifier, extended = message.arbitration_id, self._identifiers.extended
        name = self._identifiers.receives.get(identifier)
        if identifier in self._own and message.is_extended_id == extended:
            if self._is_own(identifier, bytes(message.data), shared=name is not None) or name is None:
                return None
        return None if message.is_extended_id != extended or message.is_remote_frame else name

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
            self.foreign = (
                f"another sender uses identifier 0x{identifier:X} of this bench (data {data.hex(' ')}); "
                "two masters must not steer one cycler"
            )
        return False

    def _deliver(self, name: str, data: bytes) -> None:
        awaited = self._awaited
        if awaited is None:
            self._keep(name, data)
        elif name in awaited.refusals:
            self._keep(name, data)
            awaited.missing.clear()
            awaited.missing.add(name)
            awaited.end()
        elif name not in awaited.missing:
            self._keep(name, data)
        elif awaited.accept(name, data):  # else the answer to an earlier question
            self._keep(name, data)
            awaited.missing.discard(name)
            if not awaited.missing:
                awaited.end()

    def _keep(self, name: str, data: bytes) -> None:
        self.newest[name] = time.monotonic(), data
