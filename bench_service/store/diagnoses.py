"""Diagnoses of runs with models."""

import uuid
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import Row, select

from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile, matching
from bench_service.store.belonging import cell_of_runs
from bench_service.store.records import Json, RunReference


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisRecord:
    """A diagnosis of runs with a model; `result` is the JSON of the command ``diagnose``.

    `train` are the runs that the model's own data were taken from, besides the diagnosed `runs`.
    """

    id: str
    model_id: str
    runs: tuple[RunReference, ...]
    train: tuple[RunReference, ...]
    mode: str
    initial_soc: float | None
    result: Json
    created_utc: str
    campaign_id: str | None
    code_version: str
    cell_id: str | None = None

    @property
    def run_ids(self) -> tuple[str, ...]:
        """Ids of the diagnosed runs."""
        return tuple(reference.run_id for reference in self.runs)

    @property
    def train_run_ids(self) -> tuple[str, ...]:
        """Ids of the runs that the model's own data were taken from."""
        return tuple(reference.run_id for reference in self.train)


class DiagnosisTable:
    """The diagnoses of one data directory; methods may be called from several threads.

    Parameters
    ----------
    file : MetadataFile
    now : callable
        Returns the present time as records have it.
    """

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(
        self,
        model_id: str,
        runs: Sequence[RunReference],
        result: Json,
        *,
        mode: str,
        code_version: str,
        train: Sequence[RunReference] = (),
        initial_soc: float | None = None,
        campaign_id: str | None = None,
    ) -> DiagnosisRecord:
        """Store a diagnosis."""
        record = DiagnosisRecord(
            id=uuid.uuid4().hex,
            model_id=model_id,
            runs=tuple(runs),
            train=tuple(train),
            mode=mode,
            initial_soc=initial_soc,
            result=result,
            created_utc=self._now(),
            campaign_id=campaign_id,
            code_version=code_version,
            cell_id=cell_of_runs(self._file, runs),
        )
        self._file.insert(schema.diagnosis, asdict(record))
        return record

    def get(self, diagnosis_id: str) -> DiagnosisRecord:
        """Return a diagnosis; raises `NotFoundError` where it is not there."""
        return _diagnosis(self._file.one(schema.diagnosis, select(schema.diagnosis), diagnosis_id))

    def page(
        self,
        model_id: str | None = None,
        limit: int = 100,
        offset: int = 0,
        cell_id: str | None = None,
        after: int | None = None,
    ) -> list[DiagnosisRecord]:
        """Return diagnoses, newest first, of one model or one cell where that is given."""
        table = schema.diagnosis
        query = matching(table, model_id=model_id, cell_id=cell_id)
        return [_diagnosis(row) for row in self._file.page(table, query, limit, offset, after)]


def _diagnosis(row: Row[Any]) -> DiagnosisRecord:
    fields = rows.fields(row)
    fields["runs"] = rows.references(row.runs)
    fields["train"] = rows.references(row.train)
    return DiagnosisRecord(**fields)
