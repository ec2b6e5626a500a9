"""A queue of campaigns per bench: the next begins when one is completed; after any other end somebody has to say so.

The rule is that of bluesky-queueserver: what was stopped, has failed or was cut off never runs again by itself, and
the queue behind it waits.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace

from bench_service.bench.messages import EventMessage
from bench_service.campaign.endings import note_end
from bench_service.campaign.journal import Journal
from bench_service.errors import BenchBusyError, BenchOfflineError, ConflictError, ServiceError, StoreError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import CampaignRecord, Json
from models.data.errors import ModelError

HELD, STARTED = "queue_held", "queue_started"


class CampaignQueue:
    """The queues of all benches; what waits is in the store and outlives the service.

    Parameters
    ----------
    store : MetadataStore
    journal : Journal
    launch : callable
        Begins a queued campaign; raises where it cannot begin.
    is_running : callable
        Whether a campaign runs on a bench.
    """

    def __init__(
        self,
        store: MetadataStore,
        journal: Journal,
        launch: Callable[[CampaignRecord], Awaitable[CampaignRecord]],
        is_running: Callable[[str], bool],
    ) -> None:
        self._store = store
        self._journal = journal
        self._launch = launch
        self._is_running = is_running
        self._held: dict[str, str | None] = {}

    async def waiting(self, bench: str) -> list[CampaignRecord]:
        """Return the campaigns that wait on a bench, the next one first."""
        return await asyncio.to_thread(self._store.campaigns.queued, bench)

    async def held(self, bench: str) -> str | None:
        """Say why the queue of a bench does not go on by itself; None where it does."""
        if bench not in self._held:
            event = await asyncio.to_thread(self._store.events.last, (HELD, STARTED), bench=bench)
            self._held[bench] = event.text if event is not None and event.code == HELD else None
        return self._held[bench]

    async def start(self, bench: str) -> None:
        """Let the queue of a bench go on: somebody has looked.

        Raises
        ------
        ConflictError
            Nothing waits.
        """
        if not await self.waiting(bench):
            raise ConflictError(f"no campaign waits on bench {bench!r}", ("bench",))
        self._note(bench, STARTED, "the queue goes on")
        await self.next(bench)

    async def after(self, ended: CampaignRecord) -> None:
        """Go on after a campaign, or wait where it was not completed."""
        if ended.state == "completed":
            await self.next(ended.bench)
        elif await self.waiting(ended.bench):
            self._note(ended.bench, HELD, f"campaign {ended.name!r} ended as {ended.state}: {ended.message}")

    async def after_restart(self, bench: str, last: CampaignRecord | None) -> None:
        """Go on when the service starts, where the last campaign on the bench was completed or there was none."""
        if last is None or last.state == "completed":
            await self.next(bench)
        elif await self.held(bench) is None and await self.waiting(bench):
            self._note(bench, HELD, f"campaign {last.name!r} ended as {last.state} with the service")

    async def next(self, bench: str) -> None:
        """Begin the next campaign of a bench, unless the queue is held."""
        if await self.held(bench) is not None or self._is_running(bench):
            return
        for record in (await self.waiting(bench))[:1]:
            try:
                await self._launch(record)
            except (BenchBusyError, BenchOfflineError, StoreError) as error:
                # Of the bench or the disk, not of the campaign: that waits on, until somebody has looked.
                if not self._is_running(bench):
                    self._note(bench, HELD, f"campaign {record.name!r} could not begin: {error}")
            except (ServiceError, ModelError) as error:
                failed = replace(record, state="failed", message=f"did not begin: {error}")
                note_end(self._journal, failed)
                await self._journal.write(self._store.campaigns.save, failed)
                if await self.waiting(bench):
                    self._note(bench, HELD, f"campaign {record.name!r} did not begin: {error}")

    async def to_json(self, bench: str) -> Json:
        """Give the JSON object of the REST API, without the campaign that runs."""
        waiting = await self.waiting(bench)
        hours = [((each.done or {}).get("estimate") or {}).get("hours") for each in waiting]
        known = None if None in hours else sum(hour or 0.0 for hour in hours)
        names = [{"id": each.id, "name": each.name, "hours": hour} for each, hour in zip(waiting, hours, strict=True)]
        return {"bench": bench, "held": await self.held(bench), "waiting": names, "hours": known}

    def _note(self, bench: str, code: str, text: str) -> None:
        self._held[bench] = text if code == HELD else None
        severity = "warning" if code == HELD else "info"
        text = f"the queue of bench {bench!r} waits: {text}; start it again" if code == HELD else text
        self._journal.note(bench, EventMessage(severity=severity, code=code, text=text, run_id=None))
