"""How campaigns end, and what is told of them."""

from __future__ import annotations

import asyncio
from dataclasses import asdict, replace

from bench_service.bench.messages import EventMessage
from bench_service.campaign.estimate import time_left
from bench_service.campaign.journal import Journal
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import CampaignRecord, CampaignState, Json, Severity, Stage

_SEVERITY: dict[str, Severity] = {"completed": "info", "stopped": "warning", "interrupted": "warning"}
_LATEST_CAMPAIGNS = 1000


def campaign_json(record: CampaignRecord) -> Json:
    """Return the JSON object of the REST API."""
    return {name: value for name, value in asdict(record).items() if name != "done"} | time_left(record)


async def close_left_open(store: MetadataStore, journal: Journal) -> None:
    """Write the campaigns down as interrupted that the end of an earlier service has cut off."""
    for record in await asyncio.to_thread(store.campaigns.page, _LATEST_CAMPAIGNS):
        if record.state == "running":
            cut_off = ended(record, "interrupted", "the service ended in the middle of it")
            note_end(journal, await journal.write(store.campaigns.save, cut_off))


def ended(record: CampaignRecord, state: CampaignState, message: str, result: Json | None = None) -> CampaignRecord:
    """Return the record of a campaign that did not reach its end; so did the stage that it was in."""
    stages: list[Stage] = [{**s, "state": state} if s["state"] == "running" else s for s in record.stages]
    return replace(record, state=state, message=message, stages=tuple(stages), result=result)


def note_end(journal: Journal, record: CampaignRecord) -> None:
    """Store and publish the event of a campaign's end."""
    at = "" if record.state == "completed" else f" in stage {record.stage!r}: {record.message}"
    note(journal, record, _SEVERITY.get(record.state, "error"), f"campaign_{record.state}", f"{record.state}{at}")


def note(journal: Journal, record: CampaignRecord, severity: Severity, code: str, text: str) -> None:
    """Store and publish an event of a campaign."""
    text = f"campaign {record.name!r}: {text}"
    event = EventMessage(severity=severity, code=code, text=text, run_id=None)
    journal.note(record.bench, event, record.id)
