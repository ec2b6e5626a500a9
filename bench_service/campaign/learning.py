"""A bench that learns: each run makes the next version of its model, from stored runs or as they end."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from bench_service.bench.messages import EventMessage
from bench_service.campaign.benches import Benches
from bench_service.campaign.journal import Journal
from bench_service.campaign.modelling import Modelling
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.runs import Runs
from bench_service.errors import BadRequestError, ServiceError
from bench_service.jobs.learning import LearningResult, learn_runs
from bench_service.jobs.runner import Job, JobRunner
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json, ModelOrigin, ModelRecord, RunRecord, Severity


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningOrder:
    """Runs of one cell, in time's order, that a model is to learn from; `validate_run_ids` judge every version."""

    model_id: str
    run_ids: Sequence[str]
    validate_run_ids: Sequence[str] = ()


class Learning:
    """Lets models learn from runs.

    Parameters
    ----------
    store : MetadataStore
    jobs : JobRunner
    modelling : Modelling
        Looks runs up.
    runs : Runs
    journal : Journal
        Told what was learned from a run that has ended.
    made : data directory, code version
    """

    def __init__(
        self,
        store: MetadataStore,
        jobs: JobRunner,
        modelling: Modelling,
        runs: Runs,
        journal: Journal,
        made: tuple[Path, str],
    ) -> None:
        self._store, self._jobs, self._modelling, self._runs, self._journal = store, jobs, modelling, runs, journal
        self._data_dir, self._code_version = made
        self._following: set[asyncio.Task[None]] = set()

    async def start_learning(self, order: LearningOrder) -> Job:
        """Queue it; the job's result is ``{"model", "versions": [{"run_id", "model", ...figures}]}``.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            Model or run are not there, a run has not ended, is named twice or both teaches and judges.
        """
        if both := set(order.run_ids) & set(order.validate_run_ids):
            raise BadRequestError(
                f"run {min(both)} would teach and judge", ("validate_run_ids",), remedy="name it once"
            )
        parent = await asyncio.to_thread(self._store.models.get, order.model_id)
        document = await asyncio.to_thread(self._store.models.document, order.model_id)
        runs = await asyncio.to_thread(self._modelling.inputs, order.run_ids, "run_ids", None)
        judges = list(order.validate_run_ids)
        validate = await asyncio.to_thread(self._modelling.inputs, judges, "validate_run_ids", None) if judges else []
        keep = partial(self._keep, parent, judges)
        return self._jobs.submit("learn", learn_runs, self._data_dir, document, runs, validate, store=keep)

    async def start_run(self, benches: Benches, order: RunOrder) -> RunRecord:
        """Start a run that the model learns from when it is completed, with the newest version that it has learned.

        Raises
        ------
        BadRequestError
            The order names no model; and as `Runs.start`.
        """
        if order.model_id is None:
            raise BadRequestError("a run that is to be learned from needs a model", ("model_id",), remedy="name one")
        newest = await asyncio.to_thread(self.newest, order.model_id)
        run = await self._runs.start(benches, replace(order, model_id=newest))
        task = asyncio.get_running_loop().create_task(self._follow(run, newest))
        self._following.add(task)
        task.add_done_callback(self._following.discard)
        return run

    def newest(self, model_id: str) -> str:
        """Return the last version that has been learned from a model, or its own id."""
        members = self._store.models.family(model_id)
        while True:
            children = [each for each in members if each.parent_id == model_id and _is_learned(each)]
            if not children:
                return model_id
            model_id = children[-1].id

    async def close(self) -> None:
        """Give up what has not begun: a person can have it learned later."""
        for task in self._following:
            task.cancel()
        await asyncio.gather(*self._following, return_exceptions=True)

    async def _follow(self, run: RunRecord, model_id: str) -> None:
        ended = await self._runs.wait(run.id)
        if ended.state != "completed":
            text = f"nothing is learned from {run.called}: it ended as {ended.state}"
            self._note(ended, "warning", "model_not_learned", text)
            return
        try:
            job = await self.start_learning(LearningOrder(model_id=model_id, run_ids=[run.id]))
            job = await self._jobs.wait(job.id)
            if job.result is None:
                raise BadRequestError(f"learning failed: {job.error}")
        except ServiceError as error:
            self._note(ended, "warning", "model_not_learned", f"nothing is learned from the run: {error}")
            return
        (version,) = job.result["versions"]
        made = version["model"] is not None
        text = (
            f"model {job.result['model'][:8]} learned from the run: {version['remark']}" if made else version["remark"]
        )
        self._note(ended, "info", "model_learned" if made else "model_not_learned", text)

    def _note(self, run: RunRecord, severity: Severity, code: str, text: str) -> None:
        event = EventMessage(severity=severity, code=code, text=text, run_id=run.id)
        self._journal.note(run.bench, event, run.campaign_id)

    def _keep(self, parent: ModelRecord, judges: list[str], result: LearningResult) -> Json:
        """Store the versions, each as the child of the one before; in a thread."""
        family = self._store.models.family(parent.id)
        first, last, told = family[0], parent, []
        for version in result["versions"]:
            made = None
            if version["document"] is not None:
                made = self._store.models.add(
                    version["document"],
                    ModelOrigin(
                        name=f"{first.name}, version {version['number']}",
                        structure=version["structure"],
                        capacity_Ah=version["capacity_Ah"],
                        code_version=self._code_version,
                        train=self._store.runs.references([version["run_id"]]),
                        validate=self._store.runs.references(judges),
                        metrics=version["metrics"],
                        seed=parent.seed,
                        parent_id=last.id,
                        campaign_id=parent.campaign_id,
                    ),
                )
                last = made
            told.append({"run_id": version["run_id"], "model": made and made.id, **version["metrics"]})
        return {"model": last.id, "parent": parent.id, "versions": told}


def _is_learned(model: ModelRecord) -> bool:
    return "learned_from" in (model.metrics or {})
