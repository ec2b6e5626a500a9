"""Writes to the metadata store from the event loop: in their order, without ever holding up the loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import Any, TypeVar

from bench_service.campaign.live import Broadcaster
from bench_service.store.metadata import MetadataStore

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
        self._pending: set[asyncio.Task[None]] = set()

    async def write(self, function: Callable[..., ResultT], *arguments: Any, **named: Any) -> ResultT:
        """Call a writing method of the store in the journal's thread, after all earlier calls."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._thread, lambda: function(*arguments, **named))

    def note(self, bench: str | None, event: dict[str, Any], campaign_id: str | None = None) -> None:
        """Store an event (``severity``, ``code``, ``text``, ``run_id``) and publish it; returns at once."""
        task = asyncio.get_running_loop().create_task(self._note(bench, event, campaign_id))
        self._pending.add(task)
        task.add_done_callback(self._pending.discard)

    async def close(self) -> None:
        """Wait until everything is written."""
        await asyncio.gather(*self._pending, return_exceptions=True)
        self._thread.shutdown(wait=True)

    async def _note(self, bench: str | None, event: dict[str, Any], campaign_id: str | None) -> None:
        record = await self.write(
            self._store.add_event,
            event["severity"],
            event["code"],
            event["text"],
            bench=bench,
            run_id=event["run_id"],
            campaign_id=campaign_id,
        )
        self._broadcaster.publish({"type": "event"} | asdict(record))
