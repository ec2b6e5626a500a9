"""HTTP of a service that must stay reachable: requests that never come to an end lose their place."""

from __future__ import annotations

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

# Half-sent requests must not use up the descriptors: a stop finds a place as long as there are fewer than these.
MOST_CONNECTIONS = 200
HEAD_S = 10.0
# The longest body is 20 MB.
BODY_S = 60.0


class PatientProtocol(H11Protocol):
    """Ends connections whose request does not come, and the oldest of them at once where there are too many."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.waits_since_s = 0.0
        self._handed_over = False
        self._deadline: asyncio.TimerHandle | None = None

    @property
    def waits(self) -> bool:
        """Whether the next word is the client's."""
        return self.cycle is None or self.cycle.response_complete or self.cycle.more_body

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection, in the place of one that waits if there are too many."""
        super().connection_made(transport)
        self._wait_for(HEAD_S)
        if len(self.connections) > MOST_CONNECTIONS:
            waiting = [each for each in self.connections if isinstance(each, PatientProtocol) and each.waits]
            min(waiting, key=lambda each: each.waits_since_s, default=self).give_up()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._rest()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Take what has come, and wait on for what has not."""
        before = self.cycle
        super().handle_events()
        if self._handed_over or not self.waits:
            self._rest()
        elif self.cycle is not before:
            self._wait_for(BODY_S)
        elif self._deadline is None and not self.transport.is_closing():
            self._wait_for(HEAD_S)  # the next request of a connection that is kept

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Hand the connection over; a WebSocket may be silent for as long as it likes."""
        self._handed_over = True
        super().handle_websocket_upgrade(event)

    def give_up(self) -> None:
        """End the connection at once."""
        self._rest()
        self.transport.abort()

    def _wait_for(self, seconds: float) -> None:
        self._rest()
        self.waits_since_s = self.loop.time()
        self._deadline = self.loop.call_later(seconds, self._too_late)

    def _too_late(self) -> None:
        self._deadline = None
        if self.flow.read_paused:
            self._wait_for(HEAD_S)  # the delay is ours
        elif self.waits:
            self.give_up()

    def _rest(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
