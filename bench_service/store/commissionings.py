"""Commissioning records of one data directory: what a bench's hardware was seen to do, sealed."""

from collections.abc import Callable
from dataclasses import asdict

from sqlalchemy import select

from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile
from bench_service.store.records import CommissioningRecord, Json


class CommissioningTable:
    """Stores commissioning records and finds them; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(self, bench: str, state: str, make: Callable[[str, str], Json]) -> CommissioningRecord:
        """Store a record.

        Parameters
        ----------
        bench, state : str
        make : callable
            Takes the record's id and the time, gives its sealed document.
        """
        record_id, now = rows.new_id(), self._now()
        document = make(record_id, now)
        record = CommissioningRecord(
            id=record_id, bench=bench, state=state, sha256=document["sha256"], created_utc=now, document=document
        )
        self._file.insert(schema.commissioning, asdict(record))
        return record

    def get(self, record_id: str) -> CommissioningRecord:
        """Return a record."""
        table = schema.commissioning
        return CommissioningRecord(**rows.fields(self._file.one(table, select(table), record_id)))

    def last(self, bench: str) -> CommissioningRecord | None:
        """Return the newest record of a bench; None where there is none."""
        table = schema.commissioning
        found = self._file.page(table, select(table).where(table.c.bench == bench), 1, 0)
        return CommissioningRecord(**rows.fields(found[0])) if found else None
