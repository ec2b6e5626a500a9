"""One campaign while it runs."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace

from bench_service.campaign.estimate import played
from bench_service.campaign.stages import overall_progress
from bench_service.campaign.story import Story
from bench_service.store.records import CampaignRecord, CampaignState, Json


class Telling:
    """One campaign while it runs."""

    def __init__(self, bench: str) -> None:
        self.bench = bench
        self.key = f"{bench}:{id(self)}"
        self.reason = "stopped"
        self.state: CampaignState = "stopped"
        self.story: Story | None = None
        self.estimate: Json | None = None
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
        done = self.done()
        done["played"] = played(done, stage, share, message)
        return replace(self.record, stage=stage, stages=stages, progress=progress, message=message, done=done)

    def done(self) -> Json:
        """Return what a later service goes on from, and how long all of it takes."""
        made = {} if self.story is None else self.story.done_json()
        return made | {"estimate": self.estimate}

    async def end(self, reason: str, state: CampaignState = "stopped") -> None:
        """Stop it and wait until its end is written down; harmless before it has begun."""
        if self.task is not None:
            self.reason, self.state = reason, state
            self.task.cancel()
            await asyncio.wait({self.task})
