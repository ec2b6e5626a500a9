"""Starts protocols again that something outside the cell has cut off, where their runs have said so."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from bench_service.bench.messages import EventMessage
from bench_service.campaign.benches import Benches
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.protocol_standing import left_to_resume
from bench_service.campaign.runs import Runs
from bench_service.errors import BenchBusyError, BenchOfflineError, ServiceError, StoreError
from bench_service.store.metadata import MetadataStore

_BACK_TIMEOUT_S = 120.0
_TRY_S = 0.5


class ProtocolResumer:
    """Starts again what was cut off, as soon as bench and recorder are back.

    Parameters
    ----------
    store : MetadataStore
    runs : Runs
    benches : Benches
    note : callable
        Takes the bench's name and an event.
    """

    def __init__(
        self, store: MetadataStore, runs: Runs, benches: Benches, note: Callable[[str | None, EventMessage], object]
    ) -> None:
        self._store = store
        self._runs = runs
        self._benches = benches
        self._note = note
        self._tasks: set[asyncio.Task[None]] = set()

    def look(self, bench: str) -> None:
        """Go on with what a bench's last run has left, if that is to be; returns at once."""
        task = asyncio.get_running_loop().create_task(self._resume(bench))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def close(self) -> None:
        """Give up what has not started yet."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _resume(self, bench: str) -> None:
        run = await asyncio.to_thread(left_to_resume, self._store, bench)
        if run is None:
            return
        order = RunOrder(
            bench=bench,
            protocol_id=run.protocol_id,
            dt_s=run.dt_s,
            initial_soc=run.initial_soc,
            limits=run.limits,
            model_id=run.model_id,
            name=run.name,
            seed=run.seed,
            continues=run.id,
            on_interruption=run.on_interruption,
        )
        try:
            await self._start(order)
        except ServiceError as error:
            text = f"run {run.name or run.id[:8]!r} does not go on: {error}"
            self._note(bench, EventMessage(severity="error", code="run_not_resumed", text=text, run_id=run.id))

    async def _start(self, order: RunOrder) -> None:
        """Start as soon as the bench is ready; acknowledges, which the run has declared before."""
        deadline_s = asyncio.get_running_loop().time() + _BACK_TIMEOUT_S
        while True:
            if self._benches.get(order.bench).supervisor.status.state == "fault":
                await self._benches.acknowledge(order.bench)
            try:
                await self._runs.start(self._benches, order)
                return
            except (BenchBusyError, BenchOfflineError, StoreError):
                if asyncio.get_running_loop().time() > deadline_s:
                    raise
            await asyncio.sleep(_TRY_S)
