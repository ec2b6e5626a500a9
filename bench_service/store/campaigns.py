"""Campaigns of one data directory."""

import uuid
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace

from sqlalchemy import select, update

from bench_service.errors import NotFoundError
from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile
from bench_service.store.records import CampaignRecord, CampaignState, Json, Stage


class CampaignTable:
    """Stores campaigns, keeps them up to date and finds them; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(
        self,
        *,
        name: str,
        bench: str,
        stage: str,
        stages: Sequence[Stage],
        request: Json,
        code_version: str,
        state: CampaignState = "running",
        done: Json | None = None,
    ) -> CampaignRecord:
        """Store a campaign that runs, or waits in its bench's queue."""
        record = CampaignRecord(
            id=uuid.uuid4().hex,
            name=name,
            bench=bench,
            state=state,
            stage=stage,
            stages=tuple(stages),
            request=request,
            created_utc=self._now(),
            code_version=code_version,
            done=done,
        )
        self._file.insert(schema.campaign, asdict(record))
        return record

    def save(self, record: CampaignRecord) -> CampaignRecord:
        """Store the present state of a campaign; gives it its time of ending where it has left ``running``."""
        if record.state not in ("running", "queued") and record.ended_utc is None:
            record = replace(record, ended_utc=self._now())
        table = schema.campaign
        with self._file.write() as link:
            saved = link.execute(update(table).where(table.c.id == record.id).values(asdict(record)))
        if not saved.rowcount:
            raise NotFoundError.of("campaign", record.id)
        return record

    def interrupt_open(self) -> None:
        """End the campaigns that an earlier service process left open."""
        with self._file.write() as link:
            link.execute(
                update(schema.campaign)
                .where(schema.campaign.c.state == "running")
                .values(state="interrupted", message="the service ended in the middle of it", ended_utc=self._now())
            )

    def queued(self, bench: str) -> list[CampaignRecord]:
        """Return the campaigns that wait on a bench, in the order in which they came."""
        table = schema.campaign
        query = select(table).where(table.c.bench == bench, table.c.state == "queued").order_by(table.c.number)
        with self._file.read() as link:
            return [rows.campaign(row) for row in link.execute(query)]

    def last(self, bench: str) -> CampaignRecord | None:
        """Return the newest campaign on a bench that does not wait; None where there is none."""
        table = schema.campaign
        query = select(table).where(table.c.bench == bench, table.c.state != "queued")
        found = self._file.page(table, query, 1, 0)
        return rows.campaign(found[0]) if found else None

    def get(self, campaign_id: str) -> CampaignRecord:
        """Return a campaign."""
        table = schema.campaign
        return rows.campaign(self._file.one(table, select(table), campaign_id))

    def page(self, limit: int = 100, offset: int = 0, after: int | None = None) -> list[CampaignRecord]:
        """Return campaigns."""
        table = schema.campaign
        return [rows.campaign(row) for row in self._file.page(table, select(table), limit, offset, after)]
