"""Campaigns: started, written down as they go, stopped, and found again after a restart."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import asdict, replace
from typing import Any

from bench_service.campaign.journal import Journal
from bench_service.campaign.live import Broadcaster
from bench_service.campaign.request import CampaignRequest, complete
from bench_service.campaign.story import STAGES, Story, Workshop, overall_progress
from bench_service.errors import BenchBusyError, ServiceError
from bench_service.store.records import CampaignRecord
from models.errors import ModelError

_log = logging.getLogger(__name__)


class CampaignRunner:
    """Runs campaigns, one per bench at a time.

    Parameters
    ----------
    workshop : Workshop
    journal : Journal
    live : Broadcaster
        Gets each change of a campaign.
    code_version : str
        Noted with each campaign.
    """

    def __init__(self, workshop: Workshop, journal: Journal, live: Broadcaster, code_version: str) -> None:
        self._workshop = workshop
        self._journal = journal
        self._live = live
        self._code_version = code_version
        self._running: dict[str, _Telling] = {}

    async def start(self, given: dict[str, Any]) -> CampaignRecord:
        """Start a campaign; `given` has the fields of `CampaignRequest` that the client states.

        Raises
        ------
        NotFoundError
            Unknown bench.
        BenchBusyError
            A campaign runs on the bench already.
        BadRequestError, ModelError
            The request contradicts itself.
        """
        bench = self._workshop.benches.get(given["bench"])
        request = complete(bench, given)
        if any(telling.request.bench == bench.name for telling in self._running.values()):
            raise BenchBusyError(f"a campaign runs on bench {bench.name!r} already; stop it or wait")
        telling = _Telling(request)
        # Claimed before the first wait, so that of two requests at once only one goes on.
        self._running[telling.key] = telling
        try:
            record = await self._journal.write(self._add, request)
        except BaseException:
            del self._running[telling.key]
            raise
        telling.record = record
        story = Story(self._workshop, record.id, request, lambda *news: self._report(telling, *news))
        telling.task = asyncio.create_task(self._tell(telling, story))
        self._live.publish({"type": "campaign"} | campaign_json(record))
        return record

    async def stop(self, campaign_id: str) -> CampaignRecord:
        """Stop a campaign: what runs is brought to rest, then it ends as `stopped`."""
        record = await self.get(campaign_id)
        for telling in list(self._running.values()):
            if telling.record is not None and telling.record.id == campaign_id and telling.task is not None:
                telling.task.cancel()
                await asyncio.wait({telling.task})
                return await self.get(campaign_id)
        return record

    async def get(self, campaign_id: str) -> CampaignRecord:
        """Return a campaign as it stands now."""
        for telling in self._running.values():
            if telling.record is not None and telling.record.id == campaign_id:
                return telling.record
        return await asyncio.to_thread(self._workshop.store.campaign, campaign_id)

    async def list(self, limit: int = 100, offset: int = 0) -> list[CampaignRecord]:
        """Return campaigns, the newest first, as they stand now."""
        current = {t.record.id: t.record for t in self._running.values() if t.record is not None}
        stored = await asyncio.to_thread(self._workshop.store.campaigns, limit, offset)
        return [current.get(record.id, record) for record in stored]

    async def close(self) -> None:
        """Stop all campaigns."""
        for telling in list(self._running.values()):
            if telling.task is not None:
                telling.task.cancel()
                await asyncio.wait({telling.task})

    async def mark_interrupted(self) -> None:
        """Campaigns that the end of the service cut off are written down as such."""
        for record in await asyncio.to_thread(self._workshop.store.campaigns, 1000, 0):
            if record.state == "running":
                ended = replace(record, state="interrupted", message="the service ended in the middle of it")
                await self._journal.write(self._workshop.store.save_campaign, ended)

    def _add(self, request: CampaignRequest) -> CampaignRecord:
        return self._workshop.store.add_campaign(
            name=request.name,
            bench=request.bench,
            stage=STAGES[0],
            stages=[{"name": stage, "state": "waiting", "detail": "", "seconds": None} for stage in STAGES],
            request=request.to_json(),
            code_version=self._code_version,
        )

    def _report(self, telling: _Telling, stage: str, share: float, message: str) -> None:
        assert telling.record is not None
        telling.record = telling.moved(stage, share, message)
        self._live.publish({"type": "campaign"} | campaign_json(telling.record))

    async def _tell(self, telling: _Telling, story: Story) -> None:
        assert telling.record is not None
        started_s = time.monotonic()
        try:
            result = await story.tell()
            result["seconds"] = time.monotonic() - started_s
            ended = replace(
                telling.record, state="completed", stage="done", progress=1.0, message="completed", result=result
            )
        except asyncio.CancelledError:
            await story.stop()
            ended = replace(telling.record, state="stopped", message="stopped", stages=telling.stages_ended("stopped"))
        except (ServiceError, ModelError) as error:
            ended = replace(telling.record, state="failed", message=str(error), stages=telling.stages_ended("failed"))
        except Exception as error:
            _log.exception("campaign %s failed", telling.record.id)
            message = f"an error inside the service: {error!r}"
            ended = replace(telling.record, state="failed", message=message, stages=telling.stages_ended("failed"))
        telling.record = ended
        try:
            telling.record = await self._journal.write(self._workshop.store.save_campaign, ended)
        finally:
            self._running.pop(telling.key, None)
            self._live.publish({"type": "campaign"} | campaign_json(telling.record))


class _Telling:
    """One campaign while it runs."""

    def __init__(self, request: CampaignRequest) -> None:
        self.request = request
        self.key = f"{request.bench}:{id(self)}"
        self.record: CampaignRecord | None = None
        self.task: asyncio.Task[None] | None = None
        self._stage_began_s = time.monotonic()

    def moved(self, stage: str, share: float, message: str) -> CampaignRecord:
        """Return the record with a stage's news."""
        assert self.record is not None
        if share == 0.0 and stage != self.record.stage:
            self._stage_began_s = time.monotonic()
        state = "done" if share >= 1.0 else "running"
        seconds = round(time.monotonic() - self._stage_began_s, 2)
        stages = tuple(
            {"name": s["name"], "state": state, "detail": message, "seconds": seconds} if s["name"] == stage else s
            for s in self.record.stages
        )
        progress = overall_progress(stage, share)
        return replace(self.record, stage=stage, stages=stages, progress=progress, message=message)

    def stages_ended(self, state: str) -> tuple[dict[str, Any], ...]:
        """Return the stages with the running one in the state that the campaign ended in."""
        assert self.record is not None
        return tuple(s | {"state": state} if s["state"] == "running" else s for s in self.record.stages)


def campaign_json(record: CampaignRecord) -> dict[str, Any]:
    """Return the JSON object of the REST API."""
    return asdict(record)
