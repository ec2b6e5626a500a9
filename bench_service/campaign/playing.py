"""How a campaign plays a run: waits for the bench, starts, watches, stops."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence

from bench_service.bench.latch import INTERRUPTIONS
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.resuming import Policy, order_of_rest
from bench_service.campaign.starting_again import start_again
from bench_service.campaign.workshop import Report, Workshop
from bench_service.jobs.counting import counted_soc
from bench_service.store.integrity import Expected, read_whole
from bench_service.store.records import RunRecord

_LOOK_S = 0.25
# A service on a busy machine takes half a minute to start its processes; a disk that is full stays so for longer.
_BACK_TIMEOUT_S = 300.0
# Longest wait for a bench that is being connected, as all are in the first seconds of a service.
_BENCH_TIMEOUT_S = 20.0
# A run that takes longer to end goes on ending; whoever stops a campaign gets an answer.
_REST_TIMEOUT_S = 3.0


class Playing:
    """The runs of one campaign.

    Parameters
    ----------
    workshop : Workshop
    campaign_id : str
    report : callable
        See `workshop.Report`.
    again : bool
        Whether the campaign goes on after it was cut off: its first run too waits until the bench is ready again.
    """

    def __init__(self, workshop: Workshop, campaign_id: str, report: Report, again: bool = False) -> None:
        self._workshop = workshop
        self._id = campaign_id
        self._report = report
        self._again, self._declared = again, INTERRUPTIONS

    async def play(
        self, stage: str, role: str, order: RunOrder, policy: Policy, parts: Sequence[RunRecord] = ()
    ) -> list[RunRecord]:
        """Play a profile to its end, in as many runs as it takes where the campaign goes on after interruptions.

        Parameters
        ----------
        stage : str
            In which it is played, for the report.
        role : str
            What the run is for, for people.
        order : RunOrder
            For the whole profile.
        policy : Policy
        parts : sequence of RunRecord
            What has been played of it before.

        Returns
        -------
        list of RunRecord
            All its parts, in their order; the last one is completed, or nothing was left to play.

        Raises
        ------
        CampaignFailedError, CampaignStoppedError
            It was not completed, and the campaign does not go on by itself.
        """
        found = list(parts)
        while not found or found[-1].state != "completed":
            here = order
            if found:
                store, samples = self._workshop.store, self._workshop.samples
                left = await asyncio.to_thread(order_of_rest, order, found, store, samples)
                if left is None:
                    break
                here = left
            started = await (self._start_again(stage, here) if self._again else self._start_first(stage, here))
            self._again = False
            run = await self._watch(stage, here.bench, started)
            if run.n_samples:
                found.append(run)
            if run.state != "completed":
                self._declared = policy.take(role, run)
                self._again = True
        return found

    async def _watch(self, stage: str, bench: str, started: RunRecord) -> RunRecord:
        waiting = asyncio.create_task(self._workshop.runs.wait(started.id))
        try:
            while not waiting.done():
                await asyncio.wait({waiting}, timeout=_LOOK_S)
                self._report_live(stage, bench, started.id)
        except asyncio.CancelledError:
            waiting.cancel()
            raise
        return waiting.result()

    async def _start_first(self, stage: str, order: RunOrder) -> RunRecord:
        await self._await_bench(stage, order.bench)
        return await self._start(order)

    async def _start_again(self, stage: str, order: RunOrder) -> RunRecord:
        """Wait until bench, recorder and disk are back; acknowledge what the campaign has declared before; go on."""
        with self._workshop.runs.starting(order.bench) as waiting:
            return await start_again(
                self._workshop.benches,
                order,
                waiting,
                self._start,
                lambda text, _: self._report(stage, 0.0, text),
                declared=self._declared,
                timeout_s=_BACK_TIMEOUT_S,
            )

    async def stop(self) -> None:
        """Bring what runs of the campaign to rest, and wait a moment for that."""
        runs = self._workshop.runs
        found = self._workshop.store.runs.page(campaign_id=self._id, limit=10)
        for run in found:
            runs.stop(self._workshop.benches, run, "the campaign was stopped")
        endings = [asyncio.create_task(runs.wait(run.id)) for run in found]
        if endings:
            _, late = await asyncio.wait(endings, timeout=_REST_TIMEOUT_S)
            for ending in late:
                ending.cancel()

    async def soc_after(self, run: RunRecord) -> float:
        """State of charge at the end of a run by counting what was measured."""
        data = await asyncio.to_thread(read_whole, self._workshop.samples, Expected.of(run))
        time_s, current_A = data.columns["time_s"], data.columns["current_A"]
        return float(counted_soc(time_s, current_A, run.initial_soc, run.capacity_Ah)[-1])

    def _report_live(self, stage: str, bench: str, run_id: str) -> None:
        live = self._workshop.benches.get(bench).live
        if live and live["run_id"] == run_id:
            self._report(stage, min(live["progress"] or 0.0, 0.99), f"{live['time_s'] or 0.0:.0f} s played")

    async def _await_bench(self, stage: str, bench: str) -> None:
        """Wait for a bench that is not there yet; one that stays away is refused when its run starts."""
        supervisor = self._workshop.benches.get(bench).supervisor
        if supervisor.status.state == "offline":
            self._report(stage, 0.0, f"waiting for the bench: {supervisor.status.reason}")
            with contextlib.suppress(TimeoutError):
                await supervisor.wait_for("idle", "running", "stopping", "fault", timeout_s=_BENCH_TIMEOUT_S)

    async def _start(self, order: RunOrder) -> RunRecord:
        """Start a run; a campaign that is stopped meanwhile goes on only when there is a run to stop, or none."""
        starting = asyncio.ensure_future(self._workshop.runs.start(self._workshop.benches, order))
        try:
            return await asyncio.shield(starting)
        except asyncio.CancelledError:
            await asyncio.wait({starting})
            starting.exception()  # seen; the campaign's own end says more
            raise
