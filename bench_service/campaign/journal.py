"""Writes to the metadata store from the event loop: in their order, without ever holding up the loop."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import Any, TypeVar, cast

from bench_service.bench.messages import EventMessage
from bench_service.campaign.live import Broadcaster
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Severity

_log = logging.getLogger(__name__)
ResultT = TypeVar("ResultT")


class Journal:
    """One thread for the store's one writing connection, and the events that go through it.

    Parameters
    ----------
    store : MetadataStore
    broadcaster : Broadcaster
        Gets each event once it is stored.
    """

    def __init__(self, store: MetadataStore, broadcaster: Broadcaster) -> None:
        self._store = store
        self._broadcaster = broadcaster
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="journal")
        self._pending: set[asyncio.Future[Any]] = set()

    async def write(self, function: Callable[..., ResultT], *arguments: Any, **named: Any) -> ResultT:
        """Call a writing method of the store in the journal's thread, after all earlier calls."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._thread, lambda: function(*arguments, **named))

    def post(self, function: Callable[[], ResultT], then: Callable[[ResultT], None] | None = None) -> None:
        """Call a writing method of the store after all earlier calls and before all later ones; returns at once.

        `then` gets its result, in the event loop.
        """

        def done(future: asyncio.Future[ResultT]) -> None:
            self._pending.discard(future)
            if future.cancelled():
                return
            if (error := future.exception()) is not None:
                _log.error("could not be written down: %s", error)
            elif then is not None:
                then(future.result())

        # Handed over here, not in a task: a later `write` must not overtake it.
        future = asyncio.get_running_loop().run_in_executor(self._thread, function)
        self._pending.add(future)
        future.add_done_callback(done)

    def note(
        self, bench: str | None, event: EventMessage, campaign_id: str | None = None, cell_id: str | None = None
    ) -> None:
        """Store an event and publish it; returns at once."""
        kind = (cast(Severity, event["severity"]), event["code"], event["text"])
        about = {"bench": bench, "run_id": event["run_id"], "campaign_id": campaign_id, "cell_id": cell_id}
        self.post(
            lambda: self._store.events.add(*kind, **about),
            lambda record: self._broadcaster.publish({"type": "event"} | asdict(record)),
        )

    async def close(self) -> None:
        """Wait until everything is written."""
        await asyncio.gather(*self._pending, return_exceptions=True)
        self._thread.shutdown(wait=True)
