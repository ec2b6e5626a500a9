"""Profiles, runs, models, comparisons, campaigns, events: the API process writes them, and it alone."""

import hashlib
import json
import uuid
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select, update

from bench_service.errors import ConflictError, NotFoundError
from bench_service.store import engine as engines
from bench_service.store import rows, schema
from bench_service.store.access import LOCK_FILE, MetadataFile
from bench_service.store.diagnoses import DiagnosisTable, family
from bench_service.store.engine import LockHolder
from bench_service.store.records import (
    OPEN_RUN_STATES,
    CampaignRecord,
    ComparisonRecord,
    EventRecord,
    Json,
    ModelRecord,
    ProfileRecord,
    RunRecord,
    RunReference,
    RunState,
    Severity,
    utc_text,
)


class MetadataStore:
    """The metadata of one data directory; methods may be called from several threads.

    Lists come newest first. Every method that looks for one thing raises `NotFoundError` where it is not there, and
    every method raises `StoreError` where the database fails.
    """

    def __init__(self, file: MetadataFile, clock: Callable[[], datetime]) -> None:
        self._file = file
        self._clock = clock
        self.diagnoses = DiagnosisTable(file, self._now)

    @classmethod
    def open(
        cls,
        data_dir: Path,
        *,
        url: str | None = None,
        lock_timeout_s: float = 0.0,
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> "MetadataStore":
        """Open, or create, the metadata of a data directory for reading and writing.

        Parameters
        ----------
        data_dir : Path
        url : str, optional
            Address at which this service answers, for others that find the store taken.
        lock_timeout_s : float
            How long to wait for the present writer to go.
        clock : callable
            Returns the present time, with its zone.

        Raises
        ------
        StoreError
            Another process writes them (the message names it), or the file cannot be opened.
        """
        store = cls(MetadataFile.open(data_dir, lock_timeout_s), clock)
        store.announce(url)
        return store

    @staticmethod
    def holder(data_dir: Path) -> LockHolder | None:
        """Return which process has the metadata open for writing, and its address; None where none has."""
        return engines.lock_holder(data_dir / LOCK_FILE)

    def announce(self, url: str | None) -> None:
        """Tell other processes the address at which this service answers."""
        self._file.lock.announce(url)

    def close(self) -> None:
        """Close the file and give the lock back."""
        self._file.close()

    # Profiles

    def add_profile(self, name: str, time_s: NDArray[np.float64], current_A: NDArray[np.float64]) -> ProfileRecord:
        """Store a checked profile: a current holds from its time to the next, the last row ends the profile."""
        record, row = rows.new_profile(uuid.uuid4().hex, name, time_s, current_A, self._now())
        self._file.insert(schema.profile, row)
        return record

    def profile(self, profile_id: str) -> ProfileRecord:
        """Return a profile without its points."""
        return rows.profile(self._file.one(schema.profile, rows.PROFILE, profile_id))

    def profile_points(self, profile_id: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times in s and currents in A of a profile, each of shape (n,)."""
        return rows.profile_points(self._file.one(schema.profile, select(schema.profile), profile_id))

    def profiles(self, limit: int = 100, offset: int = 0) -> list[ProfileRecord]:
        """Return profiles without their points."""
        return [rows.profile(row) for row in self._file.page(schema.profile, rows.PROFILE, limit, offset)]

    # Runs

    def add_run(
        self,
        *,
        bench: str,
        profile_id: str,
        dt_s: float,
        initial_soc: float,
        capacity_Ah: float,
        limits: Json,
        code_version: str,
        name: str | None = None,
        model_id: str | None = None,
        observer_initial_soc: float | None = None,
        seed: int | None = None,
        campaign_id: str | None = None,
    ) -> RunRecord:
        """Store the intent of a run, in state ``created``, before the bench hears of it.

        Raises
        ------
        ConflictError
            Profile, model or campaign are not there.
        """
        record = RunRecord(
            id=uuid.uuid4().hex,
            name=name,
            bench=bench,
            profile_id=profile_id,
            state="created",
            dt_s=dt_s,
            created_utc=self._now(),
            model_id=model_id,
            initial_soc=initial_soc,
            observer_initial_soc=observer_initial_soc,
            capacity_Ah=capacity_Ah,
            limits=limits,
            seed=seed,
            campaign_id=campaign_id,
            code_version=code_version,
        )
        self._file.insert(schema.run, asdict(record))
        return record

    def start_run(self, run_id: str) -> RunRecord:
        """Note that a created run plays now.

        Raises
        ------
        ConflictError
            It is not in state ``created``.
        """
        return self._move_run(run_id, ("created",), {"state": "running", "started_utc": self._now()})

    def end_run(
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
        return self._move_run(run_id, OPEN_RUN_STATES, end | counts)

    def run(self, run_id: str) -> RunRecord:
        """Return a run."""
        return rows.run(self._file.one(schema.run, select(schema.run), run_id))

    def runs(
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

    def references(self, run_ids: Sequence[str]) -> tuple[RunReference, ...]:
        """Return runs with their content hashes, as the inputs of a model or a comparison."""
        return tuple(RunReference(run_id, self.run(run_id).sha256) for run_id in run_ids)

    def interrupt_campaigns(self) -> None:
        """End the campaigns that an earlier service process left open."""
        with self._file.write() as link:
            link.execute(
                update(schema.campaign)
                .where(schema.campaign.c.state == "running")
                .values(state="interrupted", message="the service ended in the middle of it", ended_utc=self._now())
            )

    def open_runs(self) -> list[RunRecord]:
        """Return runs that have not ended."""
        with self._file.read() as link:
            return [
                rows.run(row) for row in link.execute(select(schema.run).where(schema.run.c.state.in_(OPEN_RUN_STATES)))
            ]

    def _move_run(self, run_id: str, allowed: Sequence[RunState], values: Json) -> RunRecord:
        table = schema.run
        with self._file.write() as link:
            moved = link.execute(update(table).where(table.c.id == run_id, table.c.state.in_(allowed)).values(values))
            row = link.execute(select(table).where(table.c.id == run_id)).one_or_none()
        if row is None:
            raise NotFoundError.of("run", run_id)
        if not moved.rowcount:
            raise ConflictError(f"run {run_id} is {row.state} and cannot become {values['state']}", ("run",))
        return rows.run(row)

    # Models and comparisons

    def add_model(
        self,
        document: Json,
        *,
        name: str,
        structure: str,
        capacity_Ah: float,
        code_version: str,
        train: Sequence[RunReference] = (),
        validate: Sequence[RunReference] = (),
        metrics: Json | None = None,
        seed: int | None = None,
        parent_id: str | None = None,
        campaign_id: str | None = None,
    ) -> ModelRecord:
        """Store a model with its document (MODEL.json)."""
        text = json.dumps(document, sort_keys=True, separators=(",", ":"))
        record = ModelRecord(
            id=uuid.uuid4().hex,
            name=name,
            structure=structure,
            capacity_Ah=capacity_Ah,
            seed=seed,
            parent_id=parent_id,
            train=tuple(train),
            validate=tuple(validate),
            metrics=metrics,
            sha256=hashlib.sha256(text.encode()).hexdigest(),
            created_utc=self._now(),
            campaign_id=campaign_id,
            code_version=code_version,
        )
        self._file.insert(schema.model, asdict(record) | {"document": document})
        return record

    def model(self, model_id: str) -> ModelRecord:
        """Return a model without its document."""
        return rows.model(self._file.one(schema.model, rows.MODEL, model_id))

    def model_document(self, model_id: str) -> Json:
        """Return a model's document (MODEL.json)."""
        return self._file.one(schema.model, select(schema.model.c.document), model_id).document

    def models(self, limit: int = 100, offset: int = 0) -> list[ModelRecord]:
        """Return models without their documents."""
        return [rows.model(row) for row in self._file.page(schema.model, rows.MODEL, limit, offset)]

    def family(self, model_id: str) -> list[ModelRecord]:
        """Return every model that descends from the same first version, see `store.diagnoses.family`."""
        return family(self._file, model_id)

    def add_comparison(
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
        )
        self._file.insert(schema.comparison, asdict(record))
        return record

    def comparison(self, comparison_id: str) -> ComparisonRecord:
        """Return a comparison."""
        table = schema.comparison
        return rows.comparison(self._file.one(table, select(table), comparison_id))

    def comparisons(self, model_id: str | None = None, limit: int = 100, offset: int = 0) -> list[ComparisonRecord]:
        """Return comparisons, of one model where that is given."""
        table = schema.comparison
        query = select(table) if model_id is None else select(table).where(table.c.model_id == model_id)
        return [rows.comparison(row) for row in self._file.page(table, query, limit, offset)]

    # Campaigns

    def add_campaign(
        self, *, name: str, bench: str, stage: str, stages: Sequence[Json], request: Json, code_version: str
    ) -> CampaignRecord:
        """Store a campaign in state ``running``."""
        record = CampaignRecord(
            id=uuid.uuid4().hex,
            name=name,
            bench=bench,
            state="running",
            stage=stage,
            stages=tuple(stages),
            request=request,
            created_utc=self._now(),
            code_version=code_version,
        )
        self._file.insert(schema.campaign, asdict(record))
        return record

    def save_campaign(self, record: CampaignRecord) -> CampaignRecord:
        """Store the present state of a campaign; gives it its time of ending where it has left ``running``."""
        if record.state != "running" and record.ended_utc is None:
            record = replace(record, ended_utc=self._now())
        table = schema.campaign
        with self._file.write() as link:
            saved = link.execute(update(table).where(table.c.id == record.id).values(asdict(record)))
        if not saved.rowcount:
            raise NotFoundError.of("campaign", record.id)
        return record

    def campaign(self, campaign_id: str) -> CampaignRecord:
        """Return a campaign."""
        table = schema.campaign
        return rows.campaign(self._file.one(table, select(table), campaign_id))

    def campaigns(self, limit: int = 100, offset: int = 0) -> list[CampaignRecord]:
        """Return campaigns."""
        table = schema.campaign
        return [rows.campaign(row) for row in self._file.page(table, select(table), limit, offset)]

    # Events

    def add_event(
        self,
        severity: Severity,
        code: str,
        text: str,
        *,
        bench: str | None = None,
        run_id: str | None = None,
        campaign_id: str | None = None,
    ) -> EventRecord:
        """Store an event."""
        values: Json = {"created_utc": self._now(), "severity": severity, "code": code, "text": text}
        values |= {"bench": bench, "run_id": run_id, "campaign_id": campaign_id}
        return EventRecord(id=self._file.insert(schema.event, values), **values)

    def events(self, run_id: str | None = None, limit: int = 100, offset: int = 0) -> list[EventRecord]:
        """Return events, of one run where that is given."""
        table = schema.event
        query = select(table) if run_id is None else select(table).where(table.c.run_id == run_id)
        newest = query.order_by(table.c.id.desc()).limit(limit).offset(offset)
        with self._file.read() as link:
            return [rows.event(row) for row in link.execute(newest)]

    def _now(self) -> str:
        return utc_text(self._clock())
