"""Starts protocols again that something outside the cell has cut off, where their runs have said so."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from bench_service.bench.latch import INTERRUPTIONS
from bench_service.bench.messages import EventMessage
from bench_service.campaign.benches import Benches
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.protocol_standing import left_to_resume
from bench_service.campaign.runs import Runs
from bench_service.campaign.starting_again import start_again
from bench_service.errors import ServiceError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunRecord

_BACK_TIMEOUT_S = 120.0


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
            await self._start(order, run)
        except ServiceError as error:
            self._tell(run, "error", "run_not_resumed", f"does not go on: {error}")

    async def _start(self, order: RunOrder, run: RunRecord) -> None:
        """Start as soon as the bench is ready; acknowledges an interruption, which the run has declared before."""
        said: list[str] = []

        def say(text: str, person: bool) -> None:
            if person and text not in said:
                said.append(text)
                self._tell(run, "warning", "run_waits", text)

        with self._runs.starting(order.bench) as waiting:
            await start_again(
                self._benches,
                order,
                waiting,
                lambda order: self._runs.start(self._benches, order),
                say,
                declared=INTERRUPTIONS,
                timeout_s=_BACK_TIMEOUT_S,
            )

    def _tell(self, run: RunRecord, severity: str, code: str, text: str) -> None:
        text = f"{run.called} {text}"
        self._note(run.bench, EventMessage(severity=severity, code=code, text=text, run_id=run.id))
