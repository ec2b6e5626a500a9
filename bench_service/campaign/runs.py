"""Runs: admitted, written down, started, and written down again when they end."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial

from bench_service.bench.messages import EndedMessage, EventMessage
from bench_service.bench.request import RunRequest
from bench_service.campaign.benches import Bench, Benches
from bench_service.campaign.hardware import Hardware
from bench_service.campaign.journal import Journal
from bench_service.campaign.ordering import RunOrder, request_of
from bench_service.campaign.protocol_standing import taken_up
from bench_service.campaign.run_words import gain, length
from bench_service.campaign.starting import Start, Starts
from bench_service.campaign.storage import Storage
from bench_service.errors import BenchBusyError, BenchOfflineError, ConflictError, ServiceError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json, RunIntent, RunRecord, Severity
from bench_service.store.samples import SampleReader

_log = logging.getLogger(__name__)
_RECORDER_S = 15.0
_LOOK_S = 0.1
_RETRY_S = 2.0
_SEVERITY: dict[str, Severity] = {"completed": "info", "stopped": "warning"}


class Runs:
    """Starts runs and keeps their records true.

    Parameters
    ----------
    store : MetadataStore
    samples : SampleReader
    journal : Journal
    storage : Storage
        Asked whether a run could be stored.
    code_version : str
        Noted with each run.

    Attributes
    ----------
    on_cut_off : callable
        Told the bench of a run that was interrupted, once that is written down.
    """

    def __init__(
        self, store: MetadataStore, samples: SampleReader, journal: Journal, storage: Storage, code_version: str
    ) -> None:
        self._store = store
        self._samples = samples
        self._journal = journal
        self._storage = storage
        self._code_version = code_version
        self._claimed: set[str] = set()
        self._starts = Starts()
        self._closing = asyncio.Event()
        self._to_stop: dict[str, str] = {}
        self._ends: dict[str, asyncio.Task[None]] = {}
        self._open: dict[str, asyncio.Event] = {}
        self._on_bench: dict[str, str] = {}
        self._paused: set[str] = set()
        self.on_cut_off: Callable[[str], None] = lambda _: None

    async def start(self, benches: Benches, order: RunOrder) -> RunRecord:
        """Check an order, write down the intent, start the run.

        Raises
        ------
        NotFoundError
            Unknown bench, profile or model.
        BenchBusyError, BenchOfflineError
            The bench cannot take a run now.
        BadRequestError
            The profile or the limits are not admitted.
        """
        bench = benches.get(order.bench)
        with self.starting(bench.name) as start:
            return await self._admit(bench, order, start)

    async def _admit(self, bench: Bench, order: RunOrder, start: Start) -> RunRecord:
        if order.protocol_id is not None and order.continues is not None:
            order = await asyncio.to_thread(taken_up, order, bench, self._store, self._samples)
        bench.hardware = await asyncio.to_thread(Hardware.read, self._store, bench.name, bench.config)
        request = await asyncio.to_thread(request_of, order, bench, self._store, self._storage)
        self._refuse_offline(bench)
        self.refuse_busy(bench)
        # Two orders at once: the first one holds the bench while its intent is written down.
        with self.claimed(bench):
            return await self._start(bench, order, request, start)

    def starting(self, bench: str) -> AbstractContextManager[Start]:
        """Have a stop of a bench noted meanwhile, for what waits to begin there."""
        return self._starts.one(bench)

    def refuse_busy(self, bench: Bench) -> None:
        """Raise `BenchBusyError` if a run is on the bench or a fault is latched; an offline bench is not busy."""
        status = bench.supervisor.status
        if bench.name in self._claimed or bench.name in self._on_bench.values():
            raise BenchBusyError(f"bench {bench.name!r} is busy with another run; stop it or wait")
        if status.state == "fault":
            raise BenchBusyError(f"bench {bench.name!r} has a fault: {status.reason}; acknowledge it first")

    @contextlib.contextmanager
    def claimed(self, bench: Bench) -> Iterator[None]:
        """Let no run begin on a bench meanwhile; raises `BenchBusyError` where one is there, a fault is none."""
        if bench.name in self._claimed or bench.name in self._on_bench.values():
            raise BenchBusyError(f"bench {bench.name!r} is busy with a run; stop it or wait")
        self._claimed.add(bench.name)
        try:
            yield
        finally:
            self._claimed.discard(bench.name)

    def stop(self, benches: Benches, run: RunRecord, reason: str) -> None:
        """Bring a run to its end; one that has ended is left as it is."""
        if run.id in self._open:
            bench = benches.get(run.bench)
            if bench.supervisor.status.run_id != run.id:
                self._to_stop[run.id] = reason
                self._starts.stop(run.bench, reason)
            bench.supervisor.stop(reason)
        elif run.state == "created":  # written down in this moment
            self._starts.stop(run.bench, reason)

    def stop_bench(self, benches: Benches, name: str, reason: str) -> Bench:
        """Stop whatever runs on a bench, also what its control process has not begun yet or not been told of."""
        bench = benches.get(name)
        self.on_stop(bench, reason)
        return bench

    def on_stop(self, bench: Bench, reason: str) -> None:
        """Stop whatever runs on a bench or is being started there: also what somebody has stopped past the service."""
        for run_id, on in self._on_bench.items():
            if on == bench.name and bench.supervisor.status.run_id != run_id:
                # It would not know what to stop, and is told again when it has begun.
                self._to_stop[run_id] = reason
        self._starts.stop(bench.name, reason)
        bench.supervisor.stop(reason)

    def hold(self, benches: Benches, name: str, *, on: bool) -> Bench:
        """Pause the run on a bench, or let it go on; raises `ConflictError` where nothing runs."""
        bench = benches.get(name)
        if bench.supervisor.status.state not in ("running", "paused"):
            raise ConflictError(f"bench {name!r} is {bench.supervisor.status.state}: there is no run to hold")
        bench.supervisor.hold(on=on)
        return bench

    def skip(self, benches: Benches, name: str) -> Bench:
        """End the step of the protocol on a bench; raises `ConflictError` where none plays."""
        bench = benches.get(name)
        if bench.supervisor.status.state != "running" or bench.live is None or bench.live.get("step_count") is None:
            raise ConflictError(f"bench {name!r} is {bench.supervisor.status.state}: there is no step to skip")
        bench.supervisor.skip()
        return bench

    async def wait(self, run_id: str) -> RunRecord:
        """Wait until a run has ended and is written down."""
        if run_id in self._open:
            await self._open[run_id].wait()
        return await asyncio.to_thread(self._store.runs.get, run_id)

    def on_state(self, bench: Bench) -> None:
        """Repeat a stop that came before the control process had begun the run; write down that a run is held."""
        status = bench.supervisor.status
        if status.run_id in self._open and status.state == "paused":
            self._paused.add(status.run_id)
            self._journal.post(partial(self._store.runs.pause, status.run_id))
        elif status.run_id in self._paused and status.state == "running":
            self._paused.discard(status.run_id)
            self._journal.post(partial(self._store.runs.resume, status.run_id))
        if status.state == "running" and status.run_id in self._to_stop:
            bench.supervisor.stop(self._to_stop.pop(status.run_id))

    def on_ended(self, ended: EndedMessage) -> None:
        """Write down the end of a run; returns at once."""
        self._ends[ended["run_id"]] = asyncio.get_running_loop().create_task(self._end(ended))

    async def close(self) -> None:
        """Wait until all ends are written down; the benches have been closed before."""
        self._closing.set()
        await asyncio.gather(*self._ends.values(), return_exceptions=True)

    def _refuse_offline(self, bench: Bench) -> None:
        status = bench.supervisor.status
        if status.state == "offline":
            raise BenchOfflineError(f"bench {bench.name!r} is offline: {status.reason}; check cycler and link")

    async def _start(self, bench: Bench, order: RunOrder, request: RunRequest, start: Start) -> RunRecord:
        standing = bench.standing()
        cell_id = None if bench.cell is None else bench.cell.id
        told = (order, request, standing and standing.to_json(), cell_id)
        record = await self._journal.write(self._write_intent, *told)
        self._open[record.id] = asyncio.Event()
        self._on_bench[record.id] = bench.name
        try:
            # First, as nothing may play that nobody knows of; and so before the run's end: the journal keeps the order.
            started = await self._journal.write(self._store.runs.start, record.id)
            bench.supervisor.start_run(replace(request, run_id=record.id))
        except (ServiceError, asyncio.CancelledError) as error:
            reason = f"not started: {error or 'its order was given up'}"
            counts = {"n_samples": 0, "missed_ticks": 0, "sha256": None}
            self.on_ended(EndedMessage(run_id=record.id, state="fault", reason=reason, **counts))
            # Where that cannot be stored either, it is tried again and again; whoever ordered the run hears why now.
            await asyncio.wait({self._ends[record.id]}, timeout=_RETRY_S)
            raise
        if start.stop is not None:
            bench.supervisor.stop(start.stop)  # right behind the start: the run ends before its first tick
        text = f"{started.called} started: {length(request)}, a sample each {order.dt_s:g} s, from SoC "
        self._note(started, "info", "run_started", f"{text}{order.initial_soc:.1%}{gain(request)}")
        if standing is not None and standing.warns:
            self._journal.note(bench.name, standing.warning(bench.name, started.id), started.campaign_id)
        return started

    def _write_intent(
        self, order: RunOrder, request: RunRequest, commissioning: Json | None, cell_id: str | None
    ) -> RunRecord:
        return self._store.runs.add(
            RunIntent(
                bench=order.bench,
                profile_id=order.profile_id,
                protocol_id=order.protocol_id,
                on_interruption=order.on_interruption,
                standing=order.standing,
                dt_s=order.dt_s,
                initial_soc=order.initial_soc,
                capacity_Ah=request.capacity_Ah,
                limits=request.limits.to_json(),
                code_version=self._code_version,
                name=order.name,
                model_id=order.model_id,
                observer_initial_soc=order.observer_initial_soc,
                seed=order.seed,
                campaign_id=order.campaign_id,
                continues=order.continues,
                commissioning=commissioning,
                cell_id=cell_id,
            ),
        )

    async def _end(self, ended: EndedMessage) -> None:
        run_id = ended["run_id"]
        bench = self._on_bench.get(run_id)
        try:
            if ended["n_samples"] is None:
                ended = await self._counted(ended)
            while not await self._write_end(ended) and not self._closing.is_set():
                # A full disk has room again some day; until then nobody may read that the run never ended.
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._closing.wait(), _RETRY_S)
        finally:
            self._forget(run_id)
        if ended["state"] == "interrupted" and bench is not None and not self._closing.is_set():
            self.on_cut_off(bench)

    async def _write_end(self, ended: EndedMessage) -> bool:
        run_id, state, reason = ended["run_id"], ended["state"], ended["reason"]
        counts = {"n_samples": ended["n_samples"], "missed_ticks": ended["missed_ticks"], "sha256": ended["sha256"]}
        try:
            self._note_end(await self._journal.write(self._store.runs.end, run_id, state, reason, **counts))
        except ServiceError:
            _log.exception("the end of run %s (%s: %s) could not be written down", run_id, state, reason)
            return False
        return True

    def _note_end(self, run: RunRecord) -> None:
        because = "" if run.reason is None else f": {run.reason}"
        text = f"{run.called} ended as {run.state}{because}; {run.n_samples or 0} samples stored"
        self._note(run, _SEVERITY.get(run.state, "error"), f"run_{run.state}", text)

    def _note(self, run: RunRecord, severity: Severity, code: str, text: str) -> None:
        event = EventMessage(severity=severity, code=code, text=text, run_id=run.id)
        self._journal.note(run.bench, event, run.campaign_id)

    async def _counted(self, ended: EndedMessage) -> EndedMessage:
        """Count what the recorder has of a run whose control process has died; it closes the run a moment later."""
        run_id = ended["run_id"]
        deadline_s = asyncio.get_running_loop().time() + _RECORDER_S
        while asyncio.get_running_loop().time() < deadline_s:
            closed = await asyncio.to_thread(self._samples.closed, run_id)
            if closed is not None:
                return {**ended, "n_samples": closed.n_samples, "sha256": closed.sha256}
            await asyncio.sleep(_LOOK_S)
        return {**ended, "n_samples": await asyncio.to_thread(self._samples.n_rows, run_id)}

    def _forget(self, run_id: str) -> None:
        self._to_stop.pop(run_id, None)
        self._on_bench.pop(run_id, None)
        self._paused.discard(run_id)
        self._ends.pop(run_id, None)
        if run_id in self._open:
            self._open.pop(run_id).set()
