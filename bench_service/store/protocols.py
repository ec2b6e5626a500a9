"""Protocols of one data directory."""

import hashlib
import json
import uuid
from collections.abc import Callable
from typing import Any

from sqlalchemy import Row, select

from bench_service.errors import StoreError
from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile
from bench_service.store.records import Json, ProtocolRecord

_WITHOUT_DOCUMENT = select(*(column for column in schema.protocol.c if column.name != "document"))


class ProtocolTable:
    """Stores protocols and finds them; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(self, name: str, n_steps: int, document: Json) -> ProtocolRecord:
        """Store a checked protocol."""
        record = ProtocolRecord(
            id=uuid.uuid4().hex, name=name, sha256=_hash(document), n_steps=n_steps, created_utc=self._now()
        )
        values = {name: getattr(record, name) for name in ("id", "name", "sha256", "n_steps", "created_utc")}
        self._file.insert(schema.protocol, values | {"document": document})
        return record

    def get(self, protocol_id: str) -> ProtocolRecord:
        """Return a protocol without its document."""
        return _record(self._file.one(schema.protocol, _WITHOUT_DOCUMENT, protocol_id))

    def document(self, protocol_id: str) -> Json:
        """Return a protocol's document; raises `StoreError` where it is not the one that was stored."""
        row = self._file.one(schema.protocol, select(schema.protocol), protocol_id)
        if _hash(row.document) != row.sha256:
            raise StoreError(f"protocol {protocol_id} is damaged in the store: its document has another hash")
        return row.document

    def page(self, limit: int = 100, offset: int = 0, after: int | None = None) -> list[ProtocolRecord]:
        """Return protocols without their documents."""
        return [_record(row) for row in self._file.page(schema.protocol, _WITHOUT_DOCUMENT, limit, offset, after)]


def _hash(document: Json) -> str:
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _record(row: Row[Any]) -> ProtocolRecord:
    return ProtocolRecord(**rows.fields(row))
