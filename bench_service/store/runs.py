"""Runs of one data directory: the intent before, the end after."""

import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import asdict

from sqlalchemy import case, func, or_, select, update

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

_SEARCHED = tuple(
    schema.run.c[name]
    for name in ("id", "name", "label", "operator", "notes", "bench", "reason", "created_utc", "cell_id")
)


class RunTable:
    """Stores runs, moves them from state to state and finds them; see `MetadataStore`.

    Attributes
    ----------
    on_end : callable or None
        Told each run that has ended, once that is written down; in the thread that wrote it.
    """

    def __init__(
        self, file: MetadataFile, now: Callable[[], str], monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        self._file = file
        self._now = now
        self._monotonic = monotonic
        self._started_s: dict[str, float] = {}
        self.on_end: Callable[[RunRecord], None] | None = None

    def add(self, intent: RunIntent) -> RunRecord:
        """Store the intent of a run, in state ``created``, before the bench hears of it.

        Raises
        ------
        ConflictError
            Profile, model or campaign are not there.
        """
        record = RunRecord(id=uuid.uuid4().hex, state="created", created_utc=self._now(), **asdict(intent))
        self._file.insert(schema.run, asdict(record))
        return self.get(record.id)

    def start(self, run_id: str) -> RunRecord:
        """Note that a created run plays now.

        Raises
        ------
        ConflictError
            It is not in state ``created``.
        """
        started = self._move(run_id, ("created",), {"state": "running", "started_utc": self._now()})
        self._started_s[run_id] = self._monotonic()
        return started

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

        Its length is measured, not taken from the clock, which may have been set meanwhile; no run ends before it
        began.

        Raises
        ------
        ConflictError
            It has ended already; its first end stays.
        """
        began_s, now_utc = self._started_s.get(run_id), self._now()
        elapsed_s = None if began_s is None else self._monotonic() - began_s
        began_utc = func.coalesce(schema.run.c.started_utc, schema.run.c.created_utc)
        ended_utc = case((began_utc > now_utc, began_utc), else_=now_utc)
        end: Json = {"state": state, "reason": reason, "ended_utc": ended_utc, "elapsed_s": elapsed_s}
        counts = {"n_samples": n_samples, "missed_ticks": missed_ticks, "sha256": sha256}
        ended = self._move(run_id, OPEN_RUN_STATES, end | counts)
        self._started_s.pop(run_id, None)
        if self.on_end is not None:
            self.on_end(ended)
        return ended

    def date(self, run_id: str, started_utc: str | None, ended_utc: str, elapsed_s: float) -> None:
        """Note when a run was measured that was brought in from a file; None where the file does not tell its start."""
        table = schema.run
        values = {"started_utc": started_utc, "ended_utc": ended_utc, "elapsed_s": elapsed_s}
        with self._file.write() as link:
            link.execute(update(table).where(table.c.id == run_id).values(values))

    def ended(self) -> list[RunRecord]:
        """Return the runs that have ended and whose samples are kept, the newest first."""
        table = schema.run
        query = select(table).where(table.c.state.not_in(OPEN_RUN_STATES), table.c.removed_utc.is_(None))
        with self._file.read() as link:
            return [rows.run(row) for row in link.execute(query.order_by(table.c.number.desc()))]

    def note_damage(self, run_id: str, damage: str | None) -> bool:
        """Note what is missing of a run's samples, or that nothing is any more; return whether that is news."""
        table = schema.run
        same = table.c.damage.is_(None) if damage is None else func.coalesce(table.c.damage, "") == damage
        with self._file.write() as link:
            changed = link.execute(update(table).where(table.c.id == run_id, ~same).values(damage=damage))
        return bool(changed.rowcount)

    def settle(self, run_id: str, n_samples: int, sha256: str) -> None:
        """Note count and hash of a run whose recorder did not live to give them."""
        table = schema.run
        unsettled = (table.c.id == run_id, table.c.sha256.is_(None))
        with self._file.write() as link:
            link.execute(update(table).where(*unsettled).values(n_samples=n_samples, sha256=sha256))

    def correct(self, run_id: str, n_samples: int, sha256: str | None, loss: str) -> None:
        """Note what is there of a run's samples once what was damaged has been taken out, and what is lost."""
        table = schema.run
        values = {"n_samples": n_samples, "sha256": sha256, "damage": loss, "repaired_utc": self._now()}
        with self._file.write() as link:
            link.execute(update(table).where(table.c.id == run_id).values(values))

    def describe(self, run_id: str, told: dict[str, str | None]) -> tuple[RunRecord, RunRecord]:
        """Write down what a person says of a run, in `label`, `operator` or `notes`; return it before and after."""
        table = schema.run
        before = self.get(run_id)
        if not told:
            return before, before
        with self._file.write() as link:
            link.execute(update(table).where(table.c.id == run_id).values(told))
        return before, self.get(run_id)

    def nth_of_day(self, run: RunRecord) -> int:
        """Return which of its cell's runs of that day a run is, from 1."""
        table = schema.run
        began_utc = func.coalesce(table.c.started_utc, table.c.created_utc)
        day = (run.started_utc or run.created_utc)[:10]
        same = (table.c.cell_id == run.cell_id, began_utc.startswith(day), table.c.number <= run.number)
        with self._file.read() as link:
            return int(link.execute(select(func.count()).where(*same)).scalar_one())

    def last_number(self) -> int:
        """Return the number of the newest run, 0 where there is none."""
        with self._file.read() as link:
            return int(link.execute(select(func.coalesce(func.max(schema.run.c.number), 0))).scalar_one())

    def give_up(self, run_id: str) -> None:
        """Note that the samples of a run are not kept any more."""
        table = schema.run
        with self._file.write() as link:
            link.execute(update(table).where(table.c.id == run_id).values(removed_utc=self._now(), damage=None))

    def n_damaged(self) -> int:
        """Return how many runs have damage that no repair has written down."""
        table = schema.run
        with self._file.read() as link:
            query = select(func.count()).where(table.c.damage.is_not(None), table.c.repaired_utc.is_(None))
            return int(link.execute(query).scalar_one())

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
        words: str | None = None,
        cell_id: str | None = None,
        after: int | None = None,
    ) -> list[RunRecord]:
        """Return runs, of one bench, state, campaign or cell where that is given, in whose texts each word occurs."""
        query = select(schema.run)
        for word in (words or "").split():
            query = query.where(or_(*(column.icontains(word, autoescape=True) for column in _SEARCHED)))
        for column, wanted in (("bench", bench), ("state", state), ("campaign_id", campaign_id), ("cell_id", cell_id)):
            if wanted is not None:
                query = query.where(schema.run.c[column] == wanted)
        return [rows.run(row) for row in self._file.page(schema.run, query, limit, offset, after)]

    def pause(self, run_id: str) -> RunRecord:
        """Note that somebody holds a running run; raises as `start`."""
        return self._move(run_id, ("running",), {"state": "paused"})

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
        # Whatever a caller allows, no other way than those of the table is stored.
        ways = [state for state in before(values["state"]) if state in allowed]
        with self._file.write() as link:
            moved = link.execute(update(table).where(table.c.id == run_id, table.c.state.in_(ways)).values(values))
            row = link.execute(select(table).where(table.c.id == run_id)).one_or_none()
        if row is None:
            raise NotFoundError.of("run", run_id)
        if not moved.rowcount:
            raise ConflictError(f"run {run_id} is {row.state} and cannot become {values['state']}", ("run",))
        return rows.run(row)
