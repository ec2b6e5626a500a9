"""Whether what is measured can be stored, and whether what was stored is still there; no run starts while it cannot."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Iterator

from bench_service.bench.messages import EventMessage
from bench_service.campaign.journal import Journal
from bench_service.errors import NoRoomError, ServiceError, StoreError
from bench_service.store.integrity import REMEDY, Expected, count_damage, damage_of
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json, RunRecord
from bench_service.store.samples import SampleReader
from bench_service.store.watch import MEGABYTE, FolderWatch, Room
from bench_service.streams import content_hash

_log = logging.getLogger(__name__)
_LOOK_S = 1.0
# Fresh and sealed beside each other for a while, the log of both, and indexes; measured: 24 to 48 bytes in the end.
BYTES_PER_SAMPLE = 150


class Storage:
    """The state of the data directory.

    Parameters
    ----------
    store : MetadataStore
    samples : SampleReader
    journal : Journal
    watch : FolderWatch
        Of the files that the service holds open.
    recorder_state : callable
        ``"running"``, or what is wrong with the recorder.
    floor_bytes : int
        Free space that must stay when a run has been stored.
    """

    def __init__(
        self,
        store: MetadataStore,
        samples: SampleReader,
        journal: Journal,
        watch: FolderWatch,
        recorder_state: Callable[[], str],
        floor_bytes: int,
    ) -> None:
        self._store = store
        self._samples = samples
        self._journal = journal
        self._watch = watch
        self._recorder_state = recorder_state
        self._floor_bytes = floor_bytes
        self._problem: str | None = None
        self._n_damaged = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._tasks: list[asyncio.Task[None]] = []

    async def start(self) -> None:
        """Hold every run's count against its record now, and go on with the samples themselves in the background."""
        self._loop = asyncio.get_running_loop()
        await asyncio.to_thread(self._check_counts)
        self._tasks = [asyncio.create_task(self._look()), asyncio.create_task(self._check_contents())]

    async def close(self) -> None:
        """End the watch."""
        for task in self._tasks:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    # --- what is asked ---------------------------------------------------------------------------------------

    def room(self) -> Room:
        """Return free space and floor; raises `StoreError` where the directory is gone."""
        return self._watch.room(self._floor_bytes)

    def problem(self) -> str | None:
        """Say why nothing can be stored now; None where everything can."""
        try:
            self._watch.check()
            room = self.room()
        except StoreError as error:
            return error.message
        if room.short:
            return f"the disk is nearly full: {room.in_words()}; make room"
        recorder = self._recorder_state()
        return None if recorder == "running" else f"nothing is recorded: {recorder}"

    def refuse(self, n_samples: int) -> None:
        """Refuse a run of so many samples where they could not be stored.

        Raises
        ------
        NoRoomError
            The disk is too full; the message has the figures.
        StoreError
            The data directory is gone or another, or the recorder does not run.
        """
        self._watch.check()
        room, needed = self.room(), n_samples * BYTES_PER_SAMPLE
        if room.free - needed < room.floor:
            raise NoRoomError(
                f"too little room for the run: {room.in_words()}, and {n_samples} samples take up to "
                f"{needed / MEGABYTE:.0f} MB; make room, or lower free_floor_MB in bench.toml"
            )
        recorder = self._recorder_state()
        if recorder != "running":
            raise StoreError(f"no run is taken while nothing can be recorded: {recorder}")

    def to_json(self) -> Json:
        """Give the JSON object of `/healthz`."""
        problem = self.problem()
        found: Json = {"state": "ok" if problem is None else problem, "damaged_runs": self._n_damaged}
        with contextlib.suppress(StoreError):
            room = self.room()
            found |= {"free_MB": round(room.free / MEGABYTE), "floor_MB": round(room.floor / MEGABYTE)}
        return found

    # --- damage ----------------------------------------------------------------------------------------------

    def note_damage(self, run: RunRecord, damage: str | None) -> None:
        """Write down what is wrong with a run, or that nothing is any more; from any thread."""
        if run.damage == damage or self._loop is None or not self._store.runs.note_damage(run.id, damage):
            return
        self._n_damaged = self._store.runs.n_damaged()
        if damage is None:
            told = ("info", "run_whole", f"{run.called} is whole again")
        else:
            told = ("error", "run_damaged", f"{run.called} is damaged: {damage}; {REMEDY}")
        severity, code, text = told
        event = EventMessage(severity=severity, code=code, text=text, run_id=run.id)
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._journal.note, run.bench, event, run.campaign_id)

    def _check_counts(self) -> None:
        counts = self._samples.counts()
        for run in self._store.runs.ended():
            if (damage := count_damage(run, counts.get(run.id, 0))) is not None:
                self.note_damage(run, damage)
        self._n_damaged = self._store.runs.n_damaged()

    async def _check_contents(self, unsettled: bool = False) -> None:
        """Read every run once, half of the time: days of samples must not hold up a bench that wants to write.

        With `unsettled` only those whose recorder did not live to count them.
        """
        found = await asyncio.to_thread(self._store.runs.ended)
        runs = iter([run for run in found if run.sha256 is None or not unsettled])
        while True:
            began_s = time.monotonic()
            if not await asyncio.to_thread(self._check_next, runs):
                return
            await asyncio.sleep(time.monotonic() - began_s)

    def _check_next(self, runs: Iterator[RunRecord]) -> bool:
        run = next(runs, None)
        if run is None:
            return False
        try:
            data = self._samples.read(run.id)
            damage = damage_of(Expected.of(run), data)
        except StoreError as error:
            data, damage = None, error.message
        try:
            self.note_damage(run, damage)
            if data is not None and damage is None and run.sha256 is None:
                self._store.runs.settle(run.id, data.n, content_hash(data.columns))
        except ServiceError:
            _log.exception("what is wrong with run %s could not be written down: %s", run.id, damage)
        return True

    # --- the watch -------------------------------------------------------------------------------------------

    async def _look(self) -> None:
        while True:
            self._tell(await asyncio.to_thread(self.problem))
            await asyncio.sleep(_LOOK_S)

    def _tell(self, problem: str | None) -> None:
        # Figures change with every look; what is told once is that something is wrong, or right again.
        if (problem is None) == (self._problem is None):
            self._problem = problem
            return
        self._problem = problem
        if problem is None:
            self._tasks.append(asyncio.create_task(self._check_contents(unsettled=True)))
            event = EventMessage(severity="info", code="storage_back", text="the store is in order again", run_id=None)
        else:
            event = EventMessage(severity="error", code="storage", text=f"no run is taken: {problem}", run_id=None)
        self._journal.note(None, event)
