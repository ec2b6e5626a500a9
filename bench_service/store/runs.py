"""Runs of one data directory: the intent before, the end after."""

import uuid
from collections.abc import Callable, Sequence
from dataclasses import asdict

from sqlalchemy import select, update

from bench_service.errors import ConflictError, NotFoundError
from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile
from bench_service.store.records import (
    OPEN_RUN_STATES,
    Json,
    RunIntent,
    RunRecord,
    RunReference,
    RunState,
)
from bench_service.store.run_states import before


class RunTable:
    """Stores runs, moves them from state to state and finds them; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(self, intent: RunIntent) -> RunRecord:
        """Store the intent of a run, in state ``created``, before the bench hears of it.

        Raises
        ------
        ConflictError
            Profile, model or campaign are not there.
        """
        record = RunRecord(id=uuid.uuid4().hex, state="created", created_utc=self._now(), **asdict(intent))
        self._file.insert(schema.run, asdict(record))
        return record

    def start(self, run_id: str) -> RunRecord:
        """Note that a created run plays now.

        Raises
        ------
        ConflictError
            It is not in state ``created``.
        """
        return self._move(run_id, ("created",), {"state": "running", "started_utc": self._now()})

    def end(
        self,
        run_id: str,
        state: RunState,
        reason: str | None,
        *,
        n_samples: int | None = None,
        missed_ticks: int | None = None,
        sha256: str | None = None,
    ) -> RunRecord:
        """Note how a created or running run ended.

        Raises
        ------
        ConflictError
            It has ended already; its first end stays.
        """
        end = {"state": state, "reason": reason, "ended_utc": self._now()}
        counts = {"n_samples": n_samples, "missed_ticks": missed_ticks, "sha256": sha256}
        return self._move(run_id, OPEN_RUN_STATES, end | counts)

    def get(self, run_id: str) -> RunRecord:
        """Return a run."""
        return rows.run(self._file.one(schema.run, select(schema.run), run_id))

    def page(
        self,
        bench: str | None = None,
        state: RunState | None = None,
        campaign_id: str | None = None,
        limit: int = 100,
        offset: int = 0,
    ) -> list[RunRecord]:
        """Return runs, of one bench, state or campaign where that is given."""
        query = select(schema.run)
        for column, wanted in (("bench", bench), ("state", state), ("campaign_id", campaign_id)):
            if wanted is not None:
                query = query.where(schema.run.c[column] == wanted)
        return [rows.run(row) for row in self._file.page(schema.run, query, limit, offset)]

    def pause(self, run_id: str) -> RunRecord:
        """Note that somebody holds a running run; raises as `start`."""
        return self._move(run_id, before("paused"), {"state": "paused"})

    def resume(self, run_id: str) -> RunRecord:
        """Note that a run that was held goes on; raises as `start`."""
        return self._move(run_id, ("paused",), {"state": "running"})

    def references(self, run_ids: Sequence[str]) -> tuple[RunReference, ...]:
        """Return runs with their content hashes, as the inputs of a model or a comparison."""
        return tuple(RunReference(run_id, self.get(run_id).sha256) for run_id in run_ids)

    def still_open(self) -> list[RunRecord]:
        """Return runs that have not ended."""
        with self._file.read() as link:
            return [
                rows.run(row) for row in link.execute(select(schema.run).where(schema.run.c.state.in_(OPEN_RUN_STATES)))
            ]

    def _move(self, run_id: str, allowed: Sequence[RunState], values: Json) -> RunRecord:
        table = schema.run
        with self._file.write() as link:
            moved = link.execute(update(table).where(table.c.id == run_id, table.c.state.in_(allowed)).values(values))
            row = link.execute(select(table).where(table.c.id == run_id)).one_or_none()
        if row is None:
            raise NotFoundError.of("run", run_id)
        if not moved.rowcount:
            raise ConflictError(f"run {run_id} is {row.state} and cannot become {values['state']}", ("run",))
        return rows.run(row)
