"""What a model lacks, and what adding it is worth: inputs looked up, work handed to a worker, results stored."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from bench_service.bench.limits import Limits
from bench_service.campaign.modelling import Modelling
from bench_service.campaign.versions import judging_runs
from bench_service.errors import BadRequestError, ConflictError, NotFoundError
from bench_service.jobs.diagnosing import add_effect_to, design_between, diagnose_runs, map_errors
from bench_service.jobs.refitting import refit_to
from bench_service.jobs.results import DesignResult, VersionAnswer, VersionResult
from bench_service.jobs.runner import Job, JobRunner
from bench_service.jobs.series import RunInput
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json, ModelOrigin, ModelRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisOrder:
    """Runs to be diagnosed with a model; where `train_run_ids` is None, the runs that the model was made from.

    `initial_soc_std`: of the runs' stated SoC at the start; None: that of a careful statement.
    """

    model_id: str
    run_ids: Sequence[str]
    train_run_ids: Sequence[str] | None
    mode: Literal["structure", "change"]
    initial_soc: float | None = None
    initial_soc_std: float | None = None


class Diagnosing:
    """Diagnoses models, adds effects to them, and refits them.

    Parameters
    ----------
    store : MetadataStore
    jobs : JobRunner
    modelling : Modelling
        Looks runs up.
    data_dir : Path
        Where workers read samples.
    code_version : str
        Noted with each result.
    """

    def __init__(
        self, store: MetadataStore, jobs: JobRunner, modelling: Modelling, data_dir: Path, code_version: str
    ) -> None:
        self._store = store
        self._jobs = jobs
        self._modelling = modelling
        self._data_dir = data_dir
        self._code_version = code_version

    async def start_diagnosis(self, order: DiagnosisOrder) -> Job:
        """Queue a diagnosis; the job's result is ``{"diagnosis_id", "verdict"}``.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            Model or run are not there, a run has not ended, is named twice or in both lists.
        """
        document, runs, train = await asyncio.to_thread(self._diagnosis_inputs, order)

        def keep(result: Json) -> Json:
            record = self._store.diagnoses.add(
                order.model_id,
                self._store.runs.references([run.run_id for run in runs]),
                result,
                mode=order.mode,
                code_version=self._code_version,
                train=self._store.runs.references([run.run_id for run in train]),
                initial_soc=order.initial_soc,
            )
            return {"diagnosis_id": record.id, "verdict": result["verdict"]}

        std = order.initial_soc_std
        return self._jobs.submit(
            "diagnosis", diagnose_runs, self._data_dir, document, runs, train, order.mode, std, store=keep
        )

    async def start_addition(
        self,
        model_id: str,
        effect: str,
        train_run_ids: Sequence[str] | None = None,
        validate_run_ids: Sequence[str] | None = None,
    ) -> Job:
        """Queue the addition of an effect; the job's result is the ``add-effect`` object of the public contract.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            Model, effect or run are not there, a run has not ended, or would both train and judge.
        """
        parent, document, train, validate = await asyncio.to_thread(
            self._version_inputs, model_id, train_run_ids, validate_run_ids, effect
        )

        keep = partial(self._keep_version, parent, f"{parent.name} + {effect}", train, validate)
        return self._jobs.submit(
            "add-effect", add_effect_to, self._data_dir, document, effect, train, validate, store=keep
        )

    async def start_refit(
        self, model_id: str, train_run_ids: Sequence[str], validate_run_ids: Sequence[str] | None = None
    ) -> Job:
        """Queue a refit of a model to new runs; the job's result is as that of `start_addition`, without an effect.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            Model or run are not there, a run has not ended, or would both train and judge.
        """
        parent, document, train, validate = await asyncio.to_thread(
            self._version_inputs, model_id, train_run_ids, validate_run_ids
        )
        keep = partial(self._keep_version, parent, f"{parent.name}, refitted", train, validate)
        return self._jobs.submit("refit", refit_to, self._data_dir, document, train, validate, store=keep)

    def _keep_version(
        self, parent: ModelRecord, name: str, train: list[RunInput], validate: list[RunInput], result: VersionResult
    ) -> VersionAnswer:
        metrics = result["metrics"]
        record = self._store.models.add(
            result["document"],
            ModelOrigin(
                name=name,
                structure=result["structure"],
                capacity_Ah=result["capacity_Ah"],
                code_version=self._code_version,
                train=self._store.runs.references([run.run_id for run in train]),
                validate=self._store.runs.references([run.run_id for run in validate]),
                metrics=dict(metrics),
                seed=parent.seed,
                parent_id=parent.id,
            ),
        )
        return {"model": record.id, "parent": parent.id, **metrics}

    async def start_experiment(self, diagnosis_id: str, limits: Callable[[float], Limits], standing_soc: float) -> Job:
        """Queue the design of the profile that tells a diagnosis' rivals apart on a bench.

        The job's result is ``{"profile_id", "name", "initial_soc", "dt_s", "figures"}``.

        Parameters
        ----------
        diagnosis_id : str
        limits : Callable
            Those of the bench, for a period of samples; those of the request are narrowed to them.
        standing_soc : float
            Where the cell on the bench stands.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            No such diagnosis, it asks for no experiment, or its runs cannot be used.
        """
        document, request, train, runs = await asyncio.to_thread(
            self._experiment_inputs, diagnosis_id, limits, standing_soc
        )
        name = f"{' or '.join(request['rivals'])}?"

        def keep(result: DesignResult) -> Json:
            points = np.array(result["time_s"]), np.array(result["current_A"])
            record = self._store.profiles.add(name, *points)
            settled = {key: request[key] for key in ("initial_soc", "dt_s")}
            return {"profile_id": record.id, "name": name} | settled | {"figures": result["figures"]}

        return self._jobs.submit(
            "experiment", design_between, self._data_dir, document, request, train, runs, store=keep
        )

    async def where(self, comparison_id: str) -> Json:
        """Say where the model of a comparison is off, see `models.comparison.where.error_map`; computed in a worker.

        Raises
        ------
        NotFoundError
            No such comparison.
        BadRequestError
            The samples cannot be compared any more.
        """
        document, runs = await asyncio.to_thread(self._where_inputs, comparison_id)
        job = await self._jobs.wait(self._jobs.submit("where", map_errors, self._data_dir, document, runs).id)
        if job.result is None:
            raise BadRequestError(f"the search for where the model is off failed: {job.error}")
        return dict(job.result)

    def _diagnosis_inputs(self, order: DiagnosisOrder) -> tuple[Json, list[RunInput], list[RunInput]]:
        model = self._store.models.get(order.model_id)
        runs = self._modelling.inputs(order.run_ids, "run_ids", order.initial_soc)
        chosen = {run.run_id for run in runs}
        if order.train_run_ids is not None:
            _check_apart(order.train_run_ids, chosen, "train_run_ids", "diagnosed")
        named = [run.run_id for run in model.train] if order.train_run_ids is None else order.train_run_ids
        named = [run_id for run_id in named if run_id not in chosen]
        train = self._modelling.inputs(named, "train_run_ids", None) if named else []
        return self._store.models.document(model.id), runs, train

    def _version_inputs(
        self, model_id: str, train: Sequence[str] | None, validate: Sequence[str] | None, effect: str | None = None
    ) -> tuple[ModelRecord, Json, list[RunInput], list[RunInput]]:
        # Lazy: numba and scipy take 880 ms; the first use in a service's life pays for it, not its start.
        from models.effects import effects

        if effect is not None and effect not in effects():
            raise NotFoundError(f"unknown effect {effect!r}; known are {', '.join(effects())}", ("effect",))
        parent = self._store.models.get(model_id)
        learning = list(train) if train else [run.run_id for run in parent.train]
        judging = (
            list(validate) if validate else [each for each in judging_runs(self._store, parent) if each not in learning]
        )
        if not learning:
            raise BadRequestError("the model names no runs to refit to", ("train_run_ids",), remedy="name them")
        if not judging:
            raise BadRequestError("no run would judge the result", ("validate_run_ids",), remedy="name one")
        _check_apart(judging, set(learning), "validate_run_ids", "training")
        return (
            parent,
            self._store.models.document(model_id),
            self._modelling.inputs(learning, "train_run_ids", None),
            self._modelling.inputs(judging, "validate_run_ids", None),
        )

    def _experiment_inputs(
        self, diagnosis_id: str, limits: Callable[[float], Limits], standing_soc: float
    ) -> tuple[Json, Json, list[RunInput], list[RunInput]]:
        record = self._store.diagnoses.get(diagnosis_id)
        asked = record.result.get("next_experiment")
        if not asked:
            raise ConflictError(f"diagnosis {diagnosis_id} leaves no rivals to be told apart", ("diagnosis",))
        runs = self._modelling.inputs(record.run_ids, "run_ids", record.initial_soc)
        # What has changed shows in the new runs only; what was always missing, in those that the model was made from.
        train = runs
        if record.mode == "structure" and record.train:
            train = self._modelling.inputs(record.train_run_ids, "train_run_ids", None)
        request = on_bench(asked, limits(asked["dt_s"]), standing_soc)
        return self._store.models.document(record.model_id), request, train, runs

    def _where_inputs(self, comparison_id: str) -> tuple[Json, list[RunInput]]:
        record = self._store.comparisons.get(comparison_id)
        runs = self._modelling.inputs(record.run_ids, "run_ids", record.initial_soc)
        return self._store.models.document(record.model_id), runs


def catalogue() -> list[Json]:
    """Give every effect that a diagnosis knows: name, title, how a person recognises it, parameters, source.

    ``shows_over`` names the variables that its picture is drawn over, as the profiles of a comparison have them.
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.effects import effects

    return [
        {
            "name": each.name,
            "title": each.title,
            "recognise": each.recognise,
            "source": each.source,
            "parameters": [asdict(parameter) for parameter in each.parameters],
            "shows_over": list(each.shows_over),
            "channel": each.channel,
            "absorbed": each.absorbed,
            "twin": each.twin,
            "contains": list(each.contains),
        }
        for each in effects().values()
    ]


def on_bench(asked: Json, limits: Limits, soc: float) -> Json:
    """Fit the request for an experiment to a bench: inside its limits, from where its cell stands."""
    windows = {}
    for name in ("current_A", "voltage_V", "soc"):
        low, high = getattr(limits, name)
        own = asked["limits"].get(name, (low, high))
        windows[name] = [max(own[0], low), min(own[1], high)]
    if limits.ramp_A_per_s is not None:
        windows["ramp_A_per_s"] = [-limits.ramp_A_per_s, limits.ramp_A_per_s]
    windows["soc"] = [min(windows["soc"][0], soc), max(windows["soc"][1], soc)]
    duration_s = min(asked["duration_s"], limits.duration_s)
    return asked | {"limits": windows, "initial_soc": soc, "duration_s": duration_s}


def _check_apart(run_ids: Sequence[str], others: set[str], field: str, what: str) -> None:
    for run_id in run_ids:
        if run_id in others:
            raise BadRequestError(f"run {run_id} is also a {what} run", (field,), remedy="name it once")
