"""Events of one data directory, for the people at the benches."""

from collections.abc import Callable, Sequence

from sqlalchemy import select

from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile, matching
from bench_service.store.records import EventRecord, Json, Severity


class EventTable:
    """Stores events and finds them; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(
        self,
        severity: Severity,
        code: str,
        text: str,
        *,
        bench: str | None = None,
        run_id: str | None = None,
        campaign_id: str | None = None,
        cell_id: str | None = None,
    ) -> EventRecord:
        """Store an event."""
        values: Json = {"created_utc": self._now(), "severity": severity, "code": code, "text": text}
        values |= {"bench": bench, "run_id": run_id, "campaign_id": campaign_id, "cell_id": cell_id}
        return EventRecord(id=self._file.insert(schema.event, values), **values)

    def last(
        self, codes: Sequence[str] | None, *, bench: str | None = None, run_id: str | None = None
    ) -> EventRecord | None:
        """Return the newest event with one of these codes (None: any), of a bench or a run where that is given."""
        table = schema.event
        query = select(table).order_by(table.c.id.desc()).limit(1)
        for column, wanted in ((table.c.bench, bench), (table.c.run_id, run_id)):
            if wanted is not None:
                query = query.where(column == wanted)
        if codes is not None:
            query = query.where(table.c.code.in_(codes))
        with self._file.read() as link:
            row = link.execute(query).one_or_none()
        return None if row is None else rows.event(row)

    def page(
        self,
        run_id: str | None = None,
        limit: int = 100,
        offset: int = 0,
        cell_id: str | None = None,
        after: int | None = None,
    ) -> list[EventRecord]:
        """Return events, of one run or one cell where that is given."""
        table = schema.event
        query = matching(table, run_id=run_id, cell_id=cell_id)
        return [rows.event(row) for row in self._file.page(table, query, limit, offset, after)]
