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

    def __init__(self, depth: int) -> None:
        self._waiting: deque[Message] = deque(maxlen=depth)
        self._ready = asyncio.Event()
        self.dropped = 0

    def put(self, message: Message) -> None:
        """Take a message in; never waits."""
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

    def subscribe(self) -> Subscription:
        """Start reading.

        Raises
        ------
        TooManyReadersError
            The cap is reached.
        """
        if len(self._readers) >= self._max_readers:
            raise TooManyReadersError(f"{self._max_readers} readers are connected already; close one")
        reader = Subscription(self._depth)
        self._readers.add(reader)
        return reader

    def unsubscribe(self, reader: Subscription) -> None:
        """End reading; harmless if it has ended."""
        self._readers.discard(reader)
