"""Campaigns: started, written down as they go, stopped, and found again after a restart."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import replace
from functools import partial

from bench_service.campaign.benches import Bench
from bench_service.campaign.endings import campaign_json, note, note_end
from bench_service.campaign.endings import ended as ended_as
from bench_service.campaign.journal import Journal
from bench_service.campaign.live import Broadcaster
from bench_service.campaign.plan import check_plan
from bench_service.campaign.progress import Progress
from bench_service.campaign.request import CampaignRequest, complete, standing_of
from bench_service.campaign.resuming import check_resumable, left_to_resume, parts_of
from bench_service.campaign.stages import overall_progress, stages_of
from bench_service.campaign.standing import Standing, last_standing
from bench_service.campaign.story import Story
from bench_service.campaign.workshop import CampaignStoppedError, Workshop
from bench_service.errors import BenchBusyError, ServiceError
from bench_service.store.records import CampaignRecord, CampaignState, Json, Stage
from models.data.errors import ModelError

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

    async def start(self, given: Json) -> CampaignRecord:
        """Start a campaign; `given` has the fields of `CampaignRequest` that the client states.

        Raises
        ------
        NotFoundError
            Unknown bench.
        BenchBusyError
            A campaign or a run is on the bench already, or a fault is latched.
        BadRequestError, ModelError
            The request leaves the bench's limits or contradicts itself.
        """
        bench = self._workshop.benches.get(given["bench"])
        if any(telling.bench == bench.name for telling in self._running.values()):
            raise BenchBusyError(f"a campaign runs on bench {bench.name!r} already; stop it or wait")
        self._workshop.runs.refuse_busy(bench)
        telling = _Telling(bench.name)
        # Claimed before the first wait, so that of two requests at once only one goes on.
        self._running[telling.key] = telling
        try:
            request = await asyncio.to_thread(self._admitted, bench, given)
            record = await self._journal.write(self._add, request)
        except BaseException:
            del self._running[telling.key]
            raise
        self._begin(telling, record, request, None)
        note(
            self._journal,
            record,
            "info",
            "campaign_started",
            f"runs of {request.duration_s:g} s between SoC {request.soc[0]:.0%} and {request.soc[1]:.0%}, "
            f"from {request.initial_soc:.1%} as {request.initial_soc_from} has it",
        )
        return record

    async def resume(self, campaign_id: str) -> CampaignRecord:
        """Go on with a campaign that was cut off, from what it has done and from the last stored sample.

        Raises
        ------
        NotFoundError, ConflictError, BenchBusyError
            There is none, it cannot go on, or its bench is busy.
        """
        record = await self.get(campaign_id)
        bench = self._workshop.benches.get(record.bench)
        if any(telling.bench == bench.name for telling in self._running.values()):
            raise BenchBusyError(f"a campaign runs on bench {bench.name!r} already; stop it or wait")
        telling = _Telling(bench.name)
        self._running[telling.key] = telling
        try:
            store = self._workshop.store
            parts = await asyncio.to_thread(parts_of, store, record)
            runs = [run for each in parts.values() for run in each if run.bench == bench.name]
            check_resumable(record, bench.runs_before_cell, max(runs, key=lambda run: run.number, default=None))
            stages: list[Stage] = [s if s["state"] == "done" else {**s, "state": "waiting"} for s in record.stages]
            record = replace(record, state="running", ended_utc=None, message="goes on", stages=tuple(stages))
            await self._journal.write(store.campaigns.save, record)
        except BaseException:
            del self._running[telling.key]
            raise
        played = ", ".join(f"{role} {sum(run.n_samples or 0 for run in each)}" for role, each in parts.items())
        text = f"goes on in stage {record.stage!r}; samples so far: {played or 'none'}"
        note(self._journal, record, "warning", "campaign_resumed", text)
        request = CampaignRequest.from_json(record.request)
        self._begin(telling, record, request, Progress.from_json(record.done or {}, parts))
        return record

    async def resume_by_policy(self) -> None:
        """Go on with what an earlier service has left, where the campaigns have declared it."""
        for bench in self._workshop.benches:
            left = await asyncio.to_thread(left_to_resume, self._workshop.store, bench.name)
            if left is not None and left.bench == bench.name:
                try:
                    await self.resume(left.id)
                except ServiceError as error:
                    note(self._journal, left, "error", "campaign_not_resumed", f"does not go on: {error}")

    def _begin(
        self, telling: _Telling, record: CampaignRecord, request: CampaignRequest, done: Progress | None
    ) -> None:
        telling.record = record
        telling.story = Story(self._workshop, record.id, request, lambda *news: self._report(telling, *news), done)
        telling.task = asyncio.create_task(self._tell(telling, telling.story))
        self._live.publish({"type": "campaign"} | campaign_json(record))

    async def stop(self, campaign_id: str) -> CampaignRecord:
        """Stop a campaign: what runs is brought to rest, then it ends as `stopped`."""
        record = await self.get(campaign_id)
        for telling in list(self._running.values()):
            if telling.record is not None and telling.record.id == campaign_id and telling.task is not None:
                await telling.end("stopped by a client")
                return await self.get(campaign_id)
        return record

    async def get(self, campaign_id: str) -> CampaignRecord:
        """Return a campaign as it stands now."""
        for telling in self._running.values():
            if telling.record is not None and telling.record.id == campaign_id:
                return telling.record
        return await asyncio.to_thread(self._workshop.store.campaigns.get, campaign_id)

    async def list(self, limit: int = 100, offset: int = 0) -> list[CampaignRecord]:
        """Return campaigns, the newest first, as they stand now."""
        current = {t.record.id: t.record for t in self._running.values() if t.record is not None}
        stored = await asyncio.to_thread(self._workshop.store.campaigns.page, limit, offset)
        return [current.get(record.id, record) for record in stored]

    async def close(self) -> None:
        """Interrupt all campaigns: no person has stopped them, and they may go on with the next service."""
        for telling in list(self._running.values()):
            await telling.end("the service was shut down", "interrupted")

    def _admitted(self, bench: Bench, given: Json) -> CampaignRequest:
        workshop = self._workshop
        stated = given.get("initial_soc") is not None
        last = None if stated else last_standing(bench, workshop.store, workshop.samples)
        request = complete(bench, given, last, self._changed_standing(bench, given.get("changed_bench")))
        check_plan(request, bench.limits, bench.config.capacity_Ah)
        return request

    def _changed_standing(self, bench: Bench, name: str | None) -> Standing | None:
        """Where the cell on the other bench stands, on which something may have changed."""
        if name is None or name == bench.name:
            return None
        other = self._workshop.benches.get(name)
        known = last_standing(other, self._workshop.store, self._workshop.samples)
        return known or standing_of(other)

    def _add(self, request: CampaignRequest) -> CampaignRecord:
        stages = stages_of(request)
        return self._workshop.store.campaigns.add(
            name=request.name,
            bench=request.bench,
            stage=stages[0],
            stages=[{"name": stage, "state": "waiting", "detail": "", "seconds": None} for stage in stages],
            request=request.to_json(),
            code_version=self._code_version,
        )

    def _report(self, telling: _Telling, stage: str, share: float, message: str) -> None:
        assert telling.record is not None
        telling.record = telling.moved(stage, share, message)
        if share in (0.0, 1.0) and telling.story is not None:
            telling.record = replace(telling.record, done=telling.story.done_json())
        if share in (0.0, 1.0):  # what is done is found again after a crash
            self._journal.post(partial(self._workshop.store.campaigns.save, telling.record))
        self._live.publish({"type": "campaign"} | campaign_json(telling.record))

    async def _tell(self, telling: _Telling, story: Story) -> None:
        assert telling.record is not None
        started_s = time.monotonic()
        try:
            result = await story.tell({s["name"] for s in telling.record.stages if s["state"] == "done"})
            result["seconds"] = time.monotonic() - started_s
            ended = replace(
                telling.record, state="completed", stage="done", progress=1.0, message="completed", result=result
            )
        except asyncio.CancelledError:
            await story.stop()
            ended = ended_as(telling.record, telling.state, telling.reason)
        except CampaignStoppedError as error:
            ended = ended_as(telling.record, "stopped", str(error), await _so_far(story, started_s))
        except (ServiceError, ModelError) as error:
            ended = ended_as(telling.record, "failed", str(error), await _so_far(story, started_s))
        except Exception as error:
            _log.exception("campaign %s failed", telling.record.id)
            message = f"an error inside the service: {error!r}"
            ended = ended_as(telling.record, "failed", message, await _so_far(story, started_s))
        ended = replace(ended, done=story.done_json())
        # Event and record are stored, in this order, before anybody sees that it has ended.
        note_end(self._journal, ended)
        try:
            telling.record = await self._journal.write(self._workshop.store.campaigns.save, ended)
        finally:
            self._running.pop(telling.key, None)
            self._live.publish({"type": "campaign"} | campaign_json(telling.record))


class _Telling:
    """One campaign while it runs."""

    def __init__(self, bench: str) -> None:
        self.bench = bench
        self.key = f"{bench}:{id(self)}"
        self.reason = "stopped"
        self.state: CampaignState = "stopped"
        self.story: Story | None = None
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
        progress = overall_progress([s["name"] for s in stages], stage, share)
        return replace(self.record, stage=stage, stages=stages, progress=progress, message=message)

    async def end(self, reason: str, state: CampaignState = "stopped") -> None:
        """Stop it and wait until its end is written down; harmless before it has begun."""
        if self.task is not None:
            self.reason, self.state = reason, state
            self.task.cancel()
            await asyncio.wait({self.task})


async def _so_far(story: Story, started_s: float) -> Json | None:
    """What a campaign that failed has come to before: none of it is withheld because of what came last."""
    try:
        found = await story.so_far()
    except Exception:
        _log.exception("the result so far cannot be told")
        return None
    return found | {"seconds": time.monotonic() - started_s} if found["runs"] else None
