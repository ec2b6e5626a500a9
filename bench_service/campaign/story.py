"""THE STORY of a campaign: which stage follows which, and what each hands to the next."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any

from bench_service.campaign.benches import Benches
from bench_service.campaign.modelling import FitOrder, Modelling
from bench_service.campaign.plan import TRAIN, VALIDATE, plan_profiles
from bench_service.campaign.request import OBSERVER_OFFSET_SOC, CampaignRequest
from bench_service.campaign.runs import RunOrder, Runs
from bench_service.errors import ServiceError
from bench_service.jobs.counting import counted_soc
from bench_service.jobs.runner import JobRunner
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunRecord
from bench_service.store.samples import SampleReader

STAGES = ("design", "run", "fit", "observe", "compare", "report")
# How much of the time each stage takes on a simulated bench; only the progress bar uses it.
_SHARES = {"design": 0.01, "run": 0.33, "fit": 0.3, "observe": 0.33, "compare": 0.02, "report": 0.01}
_LOOK_S = 0.25
# Longest wait for a bench that is being connected, as all are in the first seconds of a service.
_BENCH_TIMEOUT_S = 20.0
# A run that takes longer to end goes on ending; whoever stops a campaign gets an answer.
_REST_TIMEOUT_S = 3.0

Report = Callable[[str, float, str], None]


class CampaignFailedError(ServiceError):
    """A stage did not reach its end; the message says which and why."""

    code = "campaign_failed"


@dataclass(frozen=True, slots=True)
class Workshop:
    """What a campaign works with."""

    store: MetadataStore
    samples: SampleReader
    benches: Benches
    runs: Runs
    modelling: Modelling
    jobs: JobRunner


@dataclass(slots=True)
class _Progress:
    """What the stages have produced so far."""

    profiles: dict[str, str] = field(default_factory=dict)
    runs: dict[str, RunRecord] = field(default_factory=dict)
    model_id: str = ""
    fit: dict[str, Any] = field(default_factory=dict)
    comparison_id: str = ""
    comparison: dict[str, Any] = field(default_factory=dict)
    result: dict[str, Any] = field(default_factory=dict)


class Story:
    """One campaign, told stage by stage.

    Parameters
    ----------
    workshop : Workshop
    campaign_id : str
    request : CampaignRequest
    report : callable
        Takes stage, share 0..1 of the stage that is done, and one line for people.
    """

    def __init__(self, workshop: Workshop, campaign_id: str, request: CampaignRequest, report: Report) -> None:
        self._workshop = workshop
        self._id = campaign_id
        self._request = request
        self._report = report
        self._done = _Progress()

    async def tell(self) -> dict[str, Any]:
        """Go through all stages and return the campaign's result.

        Raises
        ------
        CampaignFailedError, ServiceError, ModelError
            A stage failed.
        """
        stages: dict[str, Callable[[], Coroutine[Any, Any, str]]] = {
            "design": self._design,
            "run": self._run,
            "fit": self._fit,
            "observe": self._observe,
            "compare": self._compare,
            "report": self._write_report,
        }
        for stage in STAGES:
            self._report(stage, 0.0, "")
            self._report(stage, 1.0, await stages[stage]())
        return self._done.result

    async def stop(self) -> None:
        """Bring what runs to rest, and wait a moment for that."""
        runs = self._workshop.runs
        found = self._workshop.store.runs(campaign_id=self._id, limit=10)
        for run in found:
            runs.stop(self._workshop.benches, run, "the campaign was stopped")
        endings = [asyncio.create_task(runs.wait(run.id)) for run in found]
        if endings:
            _, late = await asyncio.wait(endings, timeout=_REST_TIMEOUT_S)
            for ending in late:
                ending.cancel()

    async def _design(self) -> str:
        request = self._request
        for role, profile in (await asyncio.to_thread(plan_profiles, request)).items():
            record = await asyncio.to_thread(
                self._workshop.store.add_profile, f"{request.name}: {role}", profile.time_s, profile.current_A
            )
            self._done.profiles[role] = record.id
        return (
            f"2 profiles of {request.duration_s:g} s, SoC {request.soc[0]:.0%} to {request.soc[1]:.0%} and back, "
            f"from {request.initial_soc:.1%}"
        )

    async def _run(self) -> str:
        run = await self._play("run", TRAIN, self._request.initial_soc, None, None)
        return f"{run.n_samples} samples, {run.missed_ticks} missed"

    async def _fit(self) -> str:
        order = FitOrder(
            name=f"{self._request.name}: model",
            train=[self._done.runs[TRAIN].id],
            validate=[],
            capacity_Ah=self._request.capacity_Ah,
            structure=self._request.structure,
            seed=self._request.seed,
            campaign_id=self._id,
        )
        job = await self._workshop.modelling.start_fit(order)
        while not job.ended:
            self._report("fit", min(job.progress, 0.99), job.message)
            await asyncio.sleep(_LOOK_S)
            job = self._workshop.jobs.get(job.id)
        if job.result is None:
            raise CampaignFailedError(f"the fit failed: {job.error}")
        self._done.model_id, self._done.fit = job.result["model_id"], job.result["metrics"]
        metrics = self._done.fit
        return (
            f"{metrics['n_local_models']} local models in {metrics['seconds']:.1f} s, "
            f"{metrics['train']['rmse_mV']:.2f} mV free run on the training run"
        )

    async def _observe(self) -> str:
        """Play the second run with the observer live, started far from the truth."""
        start = await self._soc_after(self._done.runs[TRAIN])
        offset = -OBSERVER_OFFSET_SOC if start > 0.5 else OBSERVER_OFFSET_SOC
        run = await self._play("observe", VALIDATE, start, self._done.model_id, start + offset)
        return f"{run.n_samples} samples, observer started at {start + offset:.0%} with the cell at {start:.0%}"

    async def _compare(self) -> str:
        record = await self._workshop.modelling.compare(
            self._done.model_id, [self._done.runs[VALIDATE].id], None, self._id
        )
        self._done.comparison_id, self._done.comparison = record.id, record.result
        return f"{record.result['overall']['rmse_mV']:.2f} mV free run on the second run, which the fit never saw"

    async def _write_report(self) -> str:
        runs = self._done.runs
        soc = await self._workshop.modelling.soc_figures(runs[VALIDATE])
        self._done.result = {
            "runs": [
                {"run_id": run.id, "role": role, "n_samples": run.n_samples, "missed_ticks": run.missed_ticks}
                for role, run in runs.items()
            ],
            "samples": sum(run.n_samples or 0 for run in runs.values()),
            "missed_ticks": sum(run.missed_ticks or 0 for run in runs.values()),
            "model_id": self._done.model_id,
            "train": self._done.fit["train"],
            "validation": self._done.comparison["overall"],
            "sensor_noise_mV": self._done.comparison["noise_floor_mV"],
            "soc": {
                "rmse": soc["soc_rmse"],
                "max_error": soc["soc_max_error"],
                "end_error": soc["soc_end_error"],
                "converged_after_s": soc["converged_after_s"],
                "coverage_95": soc["coverage_95"],
                "started_off_by": OBSERVER_OFFSET_SOC,
            },
            "model_chain": [
                {
                    "model": self._done.model_id,
                    "effect": None,
                    "validation_rmse_mV": self._done.comparison["overall"]["rmse_mV"],
                }
            ],
            "comparison_id": self._done.comparison_id,
        }
        return "done"

    async def _play(
        self, stage: str, role: str, soc: float, model_id: str | None, observer_soc: float | None
    ) -> RunRecord:
        """Play a designed profile to its end; anything else than completion fails the campaign."""
        request = self._request
        order = RunOrder(
            bench=request.bench,
            profile_id=self._done.profiles[role],
            dt_s=request.dt_s,
            initial_soc=soc,
            model_id=model_id,
            observer_initial_soc=observer_soc,
            name=f"{request.name}: {role}",
            seed=request.seed,
            campaign_id=self._id,
        )
        await self._await_bench(stage)
        started = await self._start(order)
        waiting = asyncio.create_task(self._workshop.runs.wait(started.id))
        try:
            while not waiting.done():
                await asyncio.wait({waiting}, timeout=_LOOK_S)
                live = self._workshop.benches.get(request.bench).live
                if live and live.get("run_id") == started.id:
                    self._report(stage, min(float(live["progress"] or 0.0), 0.99), f"{live['time_s']:.0f} s played")
        except asyncio.CancelledError:
            waiting.cancel()
            raise
        run = waiting.result()
        if run.state != "completed":
            raise CampaignFailedError(f"the {role} run ended as {run.state}: {run.reason}")
        self._done.runs[role] = run
        return run

    async def _await_bench(self, stage: str) -> None:
        """Wait for a bench that is not there yet; one that stays away is refused when its run starts."""
        supervisor = self._workshop.benches.get(self._request.bench).supervisor
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

    async def _soc_after(self, run: RunRecord) -> float:
        """State of charge at the end of a run by counting what was measured."""
        data = await asyncio.to_thread(self._workshop.samples.read, run.id)
        time_s, current_A = data.columns["time_s"], data.columns["current_A"]
        return float(counted_soc(time_s, current_A, run.initial_soc, run.capacity_Ah)[-1])


def overall_progress(stage: str, share: float) -> float:
    """Share 0..1 of the whole campaign."""
    before = sum(_SHARES[s] for s in STAGES[: STAGES.index(stage)])
    return min(before + _SHARES[stage] * share, 1.0)
