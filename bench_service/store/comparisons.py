"""Comparisons of models with runs."""

import uuid
from collections.abc import Callable, Sequence
from dataclasses import asdict

from sqlalchemy import select

from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile, matching
from bench_service.store.belonging import cell_of_runs
from bench_service.store.records import ComparisonRecord, Json, RunReference


class ComparisonTable:
    """Stores comparisons and finds them; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(
        self,
        model_id: str,
        runs: Sequence[RunReference],
        result: Json,
        *,
        code_version: str,
        initial_soc: float | None = None,
        campaign_id: str | None = None,
    ) -> ComparisonRecord:
        """Store the result of comparing a model with runs."""
        record = ComparisonRecord(
            id=uuid.uuid4().hex,
            model_id=model_id,
            runs=tuple(runs),
            initial_soc=initial_soc,
            result=result,
            created_utc=self._now(),
            campaign_id=campaign_id,
            code_version=code_version,
            cell_id=cell_of_runs(self._file, runs),
        )
        self._file.insert(schema.comparison, asdict(record))
        return record

    def get(self, comparison_id: str) -> ComparisonRecord:
        """Return a comparison."""
        table = schema.comparison
        return rows.comparison(self._file.one(table, select(table), comparison_id))

    def page(
        self,
        model_id: str | None = None,
        limit: int = 100,
        offset: int = 0,
        cell_id: str | None = None,
        after: int | None = None,
    ) -> list[ComparisonRecord]:
        """Return comparisons, of one model or one cell where that is given."""
        table = schema.comparison
        query = matching(table, model_id=model_id, cell_id=cell_id)
        return [rows.comparison(row) for row in self._file.page(table, query, limit, offset, after)]
