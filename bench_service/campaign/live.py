"""Live feed: one publisher, many readers, and no reader can hold up or fill the service."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any

Message = dict[str, Any]


class TooManyReadersError(RuntimeError):
    """The feed has as many readers as it may have."""


class Subscription:
    """What one reader has not yet fetched; the oldest message goes when it is full."""

    def __init__(self, depth: int, every_s: float = 0.0) -> None:
        self._waiting: deque[Message] = deque(maxlen=depth)
        self._ready = asyncio.Event()
        self._every_s = every_s
        self._newest: dict[str, Message] = {}
        self._due: asyncio.TimerHandle | None = None
        self.dropped = 0

    def put(self, message: Message) -> None:
        """Take a message in; never waits. Values of a bench wait for their time, and newer ones take their place."""
        if self._every_s > 0.0 and message.get("type") == "live":
            self._newest[message["bench"]] = message
            if self._due is None:
                self._due = asyncio.get_running_loop().call_later(self._every_s, self._hand_on)
            return
        self._add(message)

    def end(self) -> None:
        """Stop waiting for anything."""
        if self._due is not None:
            self._due.cancel()

    def _hand_on(self) -> None:
        self._due = None
        newest, self._newest = self._newest, {}
        for message in newest.values():
            self._add(message)

    def _add(self, message: Message) -> None:
        if len(self._waiting) == self._waiting.maxlen:
            self.dropped += 1
        self._waiting.append(message)
        self._ready.set()

    async def get(self) -> Message:
        """Wait for the next message."""
        while not self._waiting:
            self._ready.clear()
            await self._ready.wait()
        return self._waiting.popleft()


class Broadcaster:
    """Hands each published message to all readers. To be used from the event loop's thread only.

    Parameters
    ----------
    max_readers : int
        Further readers are refused.
    depth : int
        Messages kept for a slow reader.
    """

    def __init__(self, max_readers: int = 20, depth: int = 200) -> None:
        self._max_readers = max_readers
        self._depth = depth
        self._readers: set[Subscription] = set()

    def publish(self, message: Message) -> None:
        """Give a message, a JSON object with a ``type``, to every reader."""
        for reader in self._readers:
            reader.put(message)

    def subscribe(self, every_s: float = 0.0) -> Subscription:
        """Start reading; of a bench's values at most one message in `every_s`, 0 for all of them.

        Raises
        ------
        TooManyReadersError
            The cap is reached.
        """
        if len(self._readers) >= self._max_readers:
            raise TooManyReadersError(f"{self._max_readers} readers are connected already; close one")
        reader = Subscription(self._depth, every_s)
        self._readers.add(reader)
        return reader

    def unsubscribe(self, reader: Subscription) -> None:
        """End reading; harmless if it has ended."""
        reader.end()
        self._readers.discard(reader)
