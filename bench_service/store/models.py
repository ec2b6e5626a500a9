"""Models of one data directory, and the family of a model: every version that descends from the same first one."""

import uuid
from collections.abc import Callable
from dataclasses import asdict

from sqlalchemy import select

from bench_service.errors import StoreError
from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile
from bench_service.store.belonging import cell_of_runs
from bench_service.store.records import Json, ModelOrigin, ModelRecord


class ModelTable:
    """Stores models with their documents and finds them; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(self, document: Json, origin: ModelOrigin) -> ModelRecord:
        """Store a model with its document (MODEL.json)."""
        record = ModelRecord(
            id=uuid.uuid4().hex,
            name=origin.name,
            structure=origin.structure,
            capacity_Ah=origin.capacity_Ah,
            seed=origin.seed,
            parent_id=origin.parent_id,
            train=tuple(origin.train),
            validate=tuple(origin.validate),
            metrics=origin.metrics,
            sha256=rows.document_hash(document),
            created_utc=self._now(),
            campaign_id=origin.campaign_id,
            code_version=origin.code_version,
            cell_id=origin.cell_id or cell_of_runs(self._file, origin.train),
        )
        self._file.insert(schema.model, asdict(record) | {"document": document})
        return record

    def get(self, model_id: str) -> ModelRecord:
        """Return a model without its document."""
        return rows.model(self._file.one(schema.model, rows.MODEL, model_id))

    def document(self, model_id: str) -> Json:
        """Return a model's document (MODEL.json).

        Raises
        ------
        StoreError
            It is not the one that was stored.
        """
        found = self._file.one(schema.model, select(schema.model.c.document, schema.model.c.sha256), model_id)
        if rows.document_hash(found.document) != found.sha256:
            raise StoreError(f"model {model_id} is damaged in the store: its document has another hash")
        return found.document

    def page(
        self, limit: int = 100, offset: int = 0, cell_id: str | None = None, after: int | None = None
    ) -> list[ModelRecord]:
        """Return models without their documents, of one cell where that is given."""
        query = rows.MODEL if cell_id is None else rows.MODEL.where(schema.model.c.cell_id == cell_id)
        return [rows.model(row) for row in self._file.page(schema.model, query, limit, offset, after)]

    def family(self, model_id: str) -> list[ModelRecord]:
        """Return every model that descends from the same first version as `model_id`, oldest first; that one leads.

        Raises
        ------
        NotFoundError
            There is no such model.
        """
        found = self.get(model_id)
        while found.parent_id is not None:
            found = self.get(found.parent_id)
        members, generation = [(0, found)], [found.id]
        with self._file.read() as link:
            while generation:
                query = rows.MODEL.where(schema.model.c.parent_id.in_(generation))
                children = [(row.number, rows.model(row)) for row in link.execute(query)]
                members += children
                generation = [child.id for _, child in children]
        return [member for _, member in sorted(members, key=lambda each: each[0])]
