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
from bench_service.campaign.estimate import NO_ESTIMATE, estimate
from bench_service.campaign.journal import Journal
from bench_service.campaign.live import Broadcaster
from bench_service.campaign.plan import check_plan
from bench_service.campaign.progress import Progress
from bench_service.campaign.queue import CampaignQueue
from bench_service.campaign.request import CampaignRequest, complete, standing_of
from bench_service.campaign.resuming import check_resumable, left_to_resume, parts_of
from bench_service.campaign.stages import stages_of
from bench_service.campaign.standing import Standing, last_standing
from bench_service.campaign.story import Story
from bench_service.campaign.telling import Telling
from bench_service.campaign.workshop import CampaignStoppedError, Workshop
from bench_service.errors import BadRequestError, BenchBusyError, ServiceError
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
        self._running: dict[str, Telling] = {}
        self._closing = False
        self._following: set[asyncio.Task[None]] = set()
        self.queue = CampaignQueue(workshop.store, journal, self._launch, self.is_running)

    async def start(self, given: Json) -> CampaignRecord:
        """Start a campaign; `given` has the fields of `CampaignRequest` that the client states.

        With ``queue`` true it waits its turn where a campaign runs or waits on the bench already.

        Raises
        ------
        NotFoundError
            Unknown bench.
        BenchBusyError
            A campaign or a run is on the bench already, or a fault is latched.
        BadRequestError, ModelError
            The request leaves the bench's limits or contradicts itself.
        """
        given = dict(given)
        bench = self._workshop.benches.get(given["bench"])
        if given.pop("queue", False) and (self.is_running(bench.name) or await self.queue.waiting(bench.name)):
            return await self._enqueue(bench, given)
        return await self._launched(bench, given, None)

    async def estimate(self, given: Json) -> Json:
        """Say how long a campaign takes, without starting it; ``refused`` says why it would not be taken."""
        bench = self._workshop.benches.get(given["bench"])
        stated = {name: value for name, value in given.items() if name != "queue"}
        try:
            request = await asyncio.to_thread(self._admitted, bench, stated)
        except (BadRequestError, ModelError) as error:
            return NO_ESTIMATE | {"refused": str(error)}
        told = await asyncio.to_thread(estimate, request, bench, self._workshop.store)
        return told.to_json() | {"refused": None}

    async def _enqueue(self, bench: Bench, given: Json) -> CampaignRecord:
        request = await asyncio.to_thread(self._admitted, bench, given)
        told = await asyncio.to_thread(estimate, request, bench, self._workshop.store)
        done = {"given": given, "estimate": told.to_json()}
        record = await self._journal.write(self._add, request, "queued", done)
        note(self._journal, record, "info", "campaign_queued", f"waits its turn: {told.in_words()}")
        self._live.publish({"type": "campaign"} | campaign_json(record))
        return record

    async def _launch(self, queued: CampaignRecord) -> CampaignRecord:
        bench = self._workshop.benches.get(queued.bench)
        return await self._launched(bench, (queued.done or {})["given"], queued)

    def is_running(self, bench: str) -> bool:
        """Whether a campaign is on a bench."""
        return any(telling.bench == bench for telling in self._running.values())

    async def _launched(self, bench: Bench, given: Json, queued: CampaignRecord | None) -> CampaignRecord:
        if self.is_running(bench.name):
            raise BenchBusyError(f"a campaign runs on bench {bench.name!r} already; stop it, wait, or queue this one")
        self._workshop.runs.refuse_busy(bench)
        telling = Telling(bench.name)
        # Claimed before the first wait, so that of two requests at once only one goes on.
        self._running[telling.key] = telling
        try:
            request = await asyncio.to_thread(self._admitted, bench, given)
            told = await asyncio.to_thread(estimate, request, bench, self._workshop.store)
            telling.estimate = told.to_json()
            if queued is None:
                record = await self._journal.write(self._add, request, "running", {"estimate": telling.estimate})
            else:
                record = replace(queued, state="running", request=request.to_json())
                await self._journal.write(self._workshop.store.campaigns.save, record)
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
            f"from {request.initial_soc:.1%} as {request.initial_soc_from} has it; {told.in_words()}",
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
        if self.is_running(bench.name):
            raise BenchBusyError(f"a campaign runs on bench {bench.name!r} already; stop it or wait")
        telling = Telling(bench.name)
        telling.estimate = (record.done or {}).get("estimate")
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
            elif left is None:
                last = await asyncio.to_thread(self._workshop.store.campaigns.last, bench.name)
                await self.queue.after_restart(bench.name, last)

    def _begin(self, telling: Telling, record: CampaignRecord, request: CampaignRequest, done: Progress | None) -> None:
        telling.record = record
        telling.story = Story(self._workshop, record.id, request, lambda *news: self._report(telling, *news), done)
        telling.task = asyncio.create_task(self._tell(telling, telling.story))
        self._live.publish({"type": "campaign"} | campaign_json(record))

    async def stop(self, campaign_id: str) -> CampaignRecord:
        """Stop a campaign: what runs is brought to rest, then it ends as `stopped`."""
        record = await self.get(campaign_id)
        if record.state == "queued":
            record = replace(record, state="stopped", message="taken out of the queue by a client")
            note_end(self._journal, record)
            return await self._journal.write(self._workshop.store.campaigns.save, record)
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

    async def list(self, limit: int = 100, offset: int = 0, after: int | None = None) -> list[CampaignRecord]:
        """Return campaigns, the newest first, as they stand now."""
        current = {t.record.id: t.record for t in self._running.values() if t.record is not None}
        stored = await asyncio.to_thread(self._workshop.store.campaigns.page, limit, offset, after)
        return [current.get(record.id, record) for record in stored]

    async def close(self) -> None:
        """Interrupt all campaigns: no person has stopped them, and they may go on with the next service."""
        self._closing = True
        for telling in list(self._running.values()):
            await telling.end("the service was shut down", "interrupted")
        await asyncio.gather(*self._following, return_exceptions=True)

    def _admitted(self, bench: Bench, given: Json) -> CampaignRequest:
        workshop = self._workshop
        stated = given.get("initial_soc") is not None
        last = None if stated else last_standing(bench, workshop.store, workshop.samples)
        request = complete(bench, given, last, self._changed_standing(bench, given.get("changed_bench")))
        check_plan(request, bench.limits, bench.config.capacity_Ah, bench.tick_s(request.dt_s))
        return request

    def _changed_standing(self, bench: Bench, name: str | None) -> Standing | None:
        """Where the cell on the other bench stands, on which something may have changed."""
        if name is None or name == bench.name:
            return None
        other = self._workshop.benches.get(name)
        known = last_standing(other, self._workshop.store, self._workshop.samples)
        return known or standing_of(other)

    def _add(self, request: CampaignRequest, state: CampaignState, done: Json) -> CampaignRecord:
        stages = stages_of(request)
        return self._workshop.store.campaigns.add(
            name=request.name,
            bench=request.bench,
            stage=stages[0],
            stages=[{"name": stage, "state": "waiting", "detail": "", "seconds": None} for stage in stages],
            request=request.to_json(),
            code_version=self._code_version,
            state=state,
            done=done,
        )

    def _report(self, telling: Telling, stage: str, share: float, message: str) -> None:
        assert telling.record is not None
        telling.record = telling.moved(stage, share, message)
        if share in (0.0, 1.0):  # what is done is found again after a crash
            self._journal.post(partial(self._workshop.store.campaigns.save, telling.record))
        self._live.publish({"type": "campaign"} | campaign_json(telling.record))

    async def _tell(self, telling: Telling, story: Story) -> None:
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
        ended = replace(ended, done=telling.done())
        # Event and record are stored, in this order, before anybody sees that it has ended.
        note_end(self._journal, ended)
        try:
            telling.record = await self._journal.write(self._workshop.store.campaigns.save, ended)
        finally:
            self._running.pop(telling.key, None)
            self._live.publish({"type": "campaign"} | campaign_json(telling.record))
            if not self._closing:
                following = asyncio.create_task(self.queue.after(telling.record))
                self._following.add(following)
                following.add_done_callback(self._following.discard)


async def _so_far(story: Story, started_s: float) -> Json | None:
    """What a campaign that failed has come to before: none of it is withheld because of what came last."""
    try:
        found = await story.so_far()
    except Exception:
        _log.exception("the result so far cannot be told")
        return None
    return found | {"seconds": time.monotonic() - started_s} if found["runs"] else None
