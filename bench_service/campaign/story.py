"""THE STORY of a campaign: which stage follows which, and what each hands to the next."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Collection, Coroutine
from functools import partial
from typing import Any, cast

from bench_service.campaign.designing import pauses_between_s, round_request
from bench_service.campaign.diagnosing import DiagnosisOrder
from bench_service.campaign.modelling import FitOrder
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.plan import CHANGED, CHANGED_VALIDATE, TRAIN, VALIDATE, plan_profiles
from bench_service.campaign.playing import Playing
from bench_service.campaign.progress import Progress, Round, campaign_result
from bench_service.campaign.request import OBSERVER_OFFSET_SOC, CampaignRequest
from bench_service.campaign.resuming import Policy, tried
from bench_service.campaign.stages import stages_of
from bench_service.campaign.workshop import CampaignFailedError, Report, Workshop
from bench_service.errors import ServiceError
from bench_service.jobs.results import ComparisonResult, FitAnswer, VersionAnswer
from bench_service.jobs.runner import Job
from bench_service.store.records import Json, RunRecord
from models.data.errors import ModelError

_LOOK_S = 0.25
# Verdicts that name an effect first, which is added.
_NAMING = ("missing", "ambiguous")


class Story:
    """One campaign, told stage by stage.

    Parameters
    ----------
    workshop : Workshop
    campaign_id : str
    request : CampaignRequest
    report : callable
        See `workshop.Report`.
    done : Progress or None
        What it has come to before it was cut off.
    """

    def __init__(
        self,
        workshop: Workshop,
        campaign_id: str,
        request: CampaignRequest,
        report: Report,
        done: Progress | None = None,
    ) -> None:
        self._workshop = workshop
        self._id = campaign_id
        self._request = request
        self._report = report
        self._done = done or Progress()
        self._policy = Policy(request.on_interruption == "resume", request.retries)
        self._playing = Playing(workshop, campaign_id, report, again=done is not None)

    def done_json(self) -> Json:
        """Return what a later service goes on from."""
        return self._done.to_json()

    async def tell(self, told: Collection[str] = ()) -> Json:
        """Go through the stages that have not been told yet and return the campaign's result.

        Raises
        ------
        CampaignFailedError, ServiceError, ModelError
            A stage failed.
        """
        stages: dict[str, Callable[[], Coroutine[Any, Any, str]]] = {
            "design": self._design,
            "run": self._run,
            "fit": self._fit,
            "rounds": self._design_again,
            "observe": self._observe,
            "compare": self._compare,
            "change": self._change,
            "diagnose": self._diagnose,
            "report": self._write_report,
        }
        for stage in stages_of(self._request):
            if stage in told:
                continue
            self._report(stage, 0.0, "")
            self._report(stage, 1.0, await stages[stage]())
        return self._done.result

    async def so_far(self) -> Json:
        """Return the result as far as the stages came before one of them failed."""
        soc = None
        if self._done.comparison is not None:
            # What failed may be what these figures need.
            with contextlib.suppress(ServiceError, ModelError):
                soc = await self._workshop.modelling.soc_figures(self._done.longest(VALIDATE))
        return campaign_result(self._done, soc)

    async def stop(self) -> None:
        """Bring what runs to rest, and wait a moment for that."""
        await self._playing.stop()

    async def _design(self) -> str:
        request = self._request
        await self._plan(request.initial_soc)
        return (
            f"{len(self._done.profiles)} profiles of {request.duration_s:g} s, "
            f"SoC {request.soc[0]:.0%} to {request.soc[1]:.0%} and back, "
            f"from {request.initial_soc:.1%}"
        )

    async def _plan(self, initial_soc: float) -> None:
        """Plan what has not been played, from where the cell stands."""
        planned = await asyncio.to_thread(plan_profiles, self._request, initial_soc, played=bool(self._done.rounds))
        for role, profile in planned.items():
            record = await asyncio.to_thread(
                self._workshop.store.profiles.add, f"{self._request.name}: {role}", profile.time_s, profile.current_A
            )
            self._done.profiles[role] = record.id

    async def _run(self) -> str:
        run = await self._play("run", TRAIN, self._request.initial_soc)
        return f"{run.n_samples} samples, {run.missed_ticks} missed"

    async def _fit(self) -> str:
        return await self._fit_round("fit", TRAIN)

    async def _fit_round(self, stage: str, role: str, design: Json | None = None) -> str:
        """Fit to all training runs so far, that of a new round with them."""
        if any(each.role == role for each in self._done.rounds):
            return "done before"
        number, parts = len(self._done.rounds) + 1, self._done.parts
        played = [run for each in self._done.rounds for run in parts[each.role]] + parts[role]
        order = FitOrder(
            name=f"{self._request.name}: model" + (f", round {number}" if number > 1 else ""),
            train=[run.id for run in played],
            validate=[],
            capacity_Ah=self._request.capacity_Ah,
            structure=self._request.structure,
            without=self._request.without,
            seed=self._request.seed,
            campaign_id=self._id,
            pauses_s=pauses_between_s(played, self._lock_step),
        )
        found: FitAnswer = await self._watched(stage, lambda: self._workshop.modelling.start_fit(order))
        metrics = found["metrics"]
        self._done.rounds.append(Round(role, found["model_id"], metrics, design))
        what = "training run" if number == 1 else f"{number} training runs"
        return (
            f"{metrics['n_local_models']} local models in {metrics['seconds']:.1f} s, "
            f"{metrics['train']['rmse_mV']:.2f} mV free run on the {what}, "
            f"{metrics['expected_rmse_mV']:.2f} mV expected on others"
        )

    @property
    def _lock_step(self) -> bool:
        return bool(self._workshop.benches.get(self._request.bench).summary()["lock_step"])

    async def _design_again(self) -> str:
        """Each round: the sequence that tells most about what the model does not know yet, played, and a refit."""
        told = ""
        for number in range(2, self._request.rounds + 1):
            role, last = f"{TRAIN}_{number}", self._done.runs[self._done.rounds[-1].role]
            if role in {each.role for each in self._done.rounds}:
                continue
            soc = await self._playing.soc_after(last)
            try:
                await self._design_round(role, soc, number)
            except CampaignFailedError as error:
                # What was learnt so far stands; that a sequence cannot be had within the limits is a result.
                told = f"{told}; " * bool(told) + f"no round {number}: {error}"
                break
            await self._play("rounds", role, soc)
            told = f"round {number}: {await self._fit_round('rounds', role, self._done.designs[role])}"
        await self._plan(await self._playing.soc_after(self._done.runs[self._done.rounds[-1].role]))
        return told

    async def _design_round(self, role: str, soc: float, number: int) -> None:
        if role in self._done.designs:
            return
        bench = self._workshop.benches.get(self._request.bench)
        asked = round_request(self._request, bench.sampled_limits(self._request.dt_s), self._done.model_id, soc, number)
        name = f"{self._request.name}: {role}"
        made = await self._watched("rounds", lambda: self._workshop.designing.start(name, asked))
        self._done.profiles[role], self._done.designs[role] = made["profile_id"], made["figures"]
        self._report("rounds", 0.0, f"round {number} is designed")

    async def _observe(self) -> str:
        """Play another run with the observer live, started far from the truth."""
        start = await self._playing.soc_after(self._done.runs[self._done.rounds[-1].role])
        offset = -OBSERVER_OFFSET_SOC if start > 0.5 else OBSERVER_OFFSET_SOC
        run = await self._play("observe", VALIDATE, start, observer_soc=start + offset)
        return f"{run.n_samples} samples, observer started at {start + offset:.0%} with the cell at {start:.0%}"

    async def _compare(self) -> str:
        """Judge the model of every round on the run that none of them has seen."""
        for each in self._done.rounds:
            order = (each.model_id, self._done.ids(VALIDATE), None, self._id)
            record = await tried(self._policy, partial(self._workshop.modelling.compare, *order))
            result = cast(ComparisonResult, record.result)
            each.held_out = result["overall"]
            self._done.comparison_id, self._done.comparison = record.id, result
        errors = " mV, then ".join(f"{each.validation_rmse_mV:.2f}" for each in self._done.rounds)
        return f"{errors} mV free run on the last run, which no fit ever saw"

    async def _change(self) -> str:
        """Play two runs on the bench on which something may have changed: one to learn from, one to judge."""
        bench = self._request.changed_bench or self._request.bench
        same = bench == self._request.bench
        start = await self._playing.soc_after(self._done.runs[VALIDATE]) if same else self._request.changed_initial_soc
        for role in (CHANGED, CHANGED_VALIDATE):
            run = await self._play("change", role, start, bench=bench)
            start = await self._playing.soc_after(run)
        return f"two runs of {self._request.duration_s:g} s on bench {bench!r}"

    async def _diagnose(self) -> str:
        """Ask what is missing, and where the answer is one effect, add it and see what that is worth."""
        mode, diagnosing = self._request.diagnose, self._workshop.diagnosing
        assert mode is not None
        ids = self._done.ids
        changed = mode == "change"
        learn = ids(CHANGED) if changed else self._done.learned
        judge = ids(CHANGED_VALIDATE if changed else VALIDATE)
        order = DiagnosisOrder(
            model_id=self._done.model_id,
            # The second run begins where the first was counted to end, which a changed capacity bends; and it judges.
            run_ids=ids(CHANGED) if changed else ids(VALIDATE),
            train_run_ids=self._done.learned,
            mode=mode,
        )
        found = await self._watched("diagnose", lambda: diagnosing.start_diagnosis(order))
        record = await asyncio.to_thread(self._workshop.store.diagnoses.get, found["diagnosis_id"])
        self._done.diagnosis = {"diagnosis_id": record.id} | record.result
        verdict, findings = record.result["verdict"], record.result["findings"]
        if verdict not in _NAMING or not findings:
            return f"verdict: {verdict.replace('_', ' ')}"
        effect = findings[0]["effect"]
        model_id = self._done.model_id
        added: VersionAnswer = await self._watched(
            "diagnose", lambda: diagnosing.start_addition(model_id, effect, learn, judge)
        )
        self._done.addition = added
        before, after = added["error_before_mV"], added["error_after_mV"]
        rivals = ", ".join(findings[0]["confounded_with"])
        named = f"{effect} is missing" if verdict == "missing" else f"{effect}, or {rivals or 'another'}, is missing"
        moves = "falls" if after < before else "rises"
        return f"{named}; {effect} added, the held-out error {moves} from {before:.2f} to {after:.2f} mV"

    async def _write_report(self) -> str:
        soc = await self._workshop.modelling.soc_figures(self._done.longest(VALIDATE))
        self._done.result = campaign_result(self._done, soc)
        return "done"

    async def _play(
        self,
        stage: str,
        role: str,
        soc: float,
        *,
        observer_soc: float | None = None,
        bench: str | None = None,
    ) -> RunRecord:
        """Play the planned profile of a role from a state of charge, on the campaign's bench or another.

        With `observer_soc` the observer of the last model runs live, started there.
        """
        request = self._request
        order = RunOrder(
            bench=bench or request.bench,
            profile_id=self._done.profiles[role],
            dt_s=request.dt_s,
            initial_soc=soc,
            model_id=None if observer_soc is None else self._done.model_id,
            observer_initial_soc=observer_soc,
            name=f"{request.name}: {role}",
            seed=request.seed,
            campaign_id=self._id,
        )
        parts = await self._playing.play(stage, role, order, self._policy, self._done.parts.get(role, ()))
        self._done.parts[role] = parts
        return parts[-1]

    async def _watched(self, stage: str, start: Callable[[], Awaitable[Job]]) -> Any:
        """Start a job, wait for it and report its progress; its result, or the end of the campaign."""
        return await tried(self._policy, lambda: self._ended(stage, start))

    async def _ended(self, stage: str, start: Callable[[], Awaitable[Job]]) -> Any:
        job = await start()
        while not job.ended:
            self._report(stage, min(job.progress, 0.99), job.message)
            await asyncio.sleep(_LOOK_S)
            job = self._workshop.jobs.get(job.id)
        if job.result is None:
            raise CampaignFailedError(f"the {job.kind} failed: {job.error}")
        return job.result
