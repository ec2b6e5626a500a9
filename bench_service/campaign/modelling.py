"""Models out of runs, and models against runs: inputs looked up, work handed to a worker, results stored."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from bench_service.campaign.cell_of_run import known_cell
from bench_service.campaign.comparison_curves import MOST_ROWS, ComparisonCurves, CurvePart
from bench_service.campaign.inputs import run_input
from bench_service.errors import BadRequestError
from bench_service.exchange.delimited import encode_csv
from bench_service.jobs.modelling import compare_runs, compare_series, compare_table, fit, observer_figures, read_tables
from bench_service.jobs.modules import ModuleWish, fit_module_runs
from bench_service.jobs.results import Curves, FitAnswer, FitResult, SocFigures
from bench_service.jobs.runner import Job, JobFunction, JobRunner
from bench_service.jobs.series import RunInput
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import ComparisonRecord, Json, ModelOrigin, ModelRecord, RunRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleOrder:
    """The runs of an order are of a module: its layout, and the model of one cell from tests of cells, where given.

    `in_series` None: as many as the runs have voltages of.
    """

    in_series: int | None = None
    parallel: int = 1
    cell_model_id: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOrder:
    """A model to be identified from stored runs.

    With `pauses_s`, from the end of each training run to the start of the next, these followed each other on one cell,
    which still knows in each what it went through before. `initial_soc_std`: how far off the states of charge may be at
    which the training runs are said to begin; `coulombic_efficiency`: share of the charge going in that comes out;
    `without`: effects that are left out of a bounded network.
    """

    name: str
    train: Sequence[str]
    validate: Sequence[str]
    capacity_Ah: float
    structure: str
    seed: int | None = None
    campaign_id: str | None = None
    pauses_s: Sequence[float] = ()
    initial_soc_std: float = 0.0
    coulombic_efficiency: float = 1.0
    without: Sequence[str] = ()
    module: ModuleOrder | None = None


class Modelling:
    """Fits, imports and compares models.

    Parameters
    ----------
    store : MetadataStore
    jobs : JobRunner
    data_dir : Path
        Where workers read samples.
    code_version : str
        Noted with each result.
    """

    def __init__(self, store: MetadataStore, jobs: JobRunner, data_dir: Path, code_version: str) -> None:
        self._store = store
        self._jobs = jobs
        self._data_dir = data_dir
        self._code_version = code_version
        self._curves = ComparisonCurves(self._simulated)

    async def start_fit(self, order: FitOrder) -> Job:
        """Queue a fit; the job's result is ``{"model_id", "metrics"}``.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            A run is not there, has not ended, or none is given.
        """
        train, validate = await asyncio.to_thread(self._fit_inputs, order)

        def keep(result: FitResult) -> FitAnswer:
            record = self._store.models.add(
                result["document"],
                ModelOrigin(
                    name=order.name,
                    structure=order.structure,
                    capacity_Ah=order.capacity_Ah,
                    code_version=self._code_version,
                    train=self._store.runs.references(order.train),
                    validate=self._store.runs.references(order.validate),
                    metrics=dict(result["metrics"]),
                    seed=order.seed,
                    campaign_id=order.campaign_id,
                ),
            )
            return {"model_id": record.id, "metrics": result["metrics"]}

        runs = (self._data_dir, train, validate, order.capacity_Ah)
        if order.module is not None:
            wish = await asyncio.to_thread(self._module_wish, order, order.module)
            return self._jobs.submit("fit", fit_module_runs, *runs, wish, store=keep)
        settled = (list(order.pauses_s), order.initial_soc_std, order.coulombic_efficiency, list(order.without))
        return self._jobs.submit("fit", fit, *runs, order.structure, *settled, store=keep)

    def import_model(self, document: Json, name: str, cell_id: str | None = None) -> ModelRecord:
        """Store a MODEL.json from elsewhere, of a cell where one is named; raises `ModelError` if it is none."""
        # Lazy: numba and scipy take 870 ms; the first use in a service's life pays for it, not its start.
        from bench_service.jobs.screening import checked_any
        from models.network.local_model_network import LocalModelNetwork

        network = checked_any(document)
        return self._store.models.add(
            document,
            ModelOrigin(
                name=name,
                structure=network.structure.name if isinstance(network, LocalModelNetwork) else network.name,
                capacity_Ah=network.cell.capacity_Ah,
                code_version=self._code_version,
                # Its figures are of runs that are not in this store; how far it can be used goes with it.
                metrics=None if network.record.usability is None else {"usability": network.record.usability},
                cell_id=known_cell(self._store, cell_id),
            ),
        )

    async def tables(self, model_id: str) -> Json:
        """Give what is read out of a model, of a module's mean cell: open-circuit voltage, resistance, heat and more.

        Raises
        ------
        NotFoundError
            No such model.
        """
        document = await asyncio.to_thread(self._store.models.document, model_id)
        if document.get("kind") == "module_network":
            document = document["cell"]
        record = document.get("record") or {}
        tables = record.get("tables") or await self._result("tables", read_tables, document)
        return {
            **tables,
            "thermal": record.get("thermal"),
            "residuals": record.get("residuals"),
            "usability": record.get("usability"),
            "local_models": (record.get("uncertainty") or {}).get("local_models"),
        }

    async def compare(
        self,
        model_id: str,
        run_ids: Sequence[str],
        initial_soc: float | None = None,
        campaign_id: str | None = None,
        baselines: Sequence[str] = (),
        train_run_ids: Sequence[str] | None = None,
    ) -> ComparisonRecord:
        """Compare a model with runs in a worker and store the result.

        `baselines` are fitted to `train_run_ids`, by default to the runs that the model was made from, and judged too.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            Model or run are not there, a run has not ended, the samples cannot be compared.
        """
        document = await asyncio.to_thread(self._store.models.document, model_id)
        runs = await asyncio.to_thread(self.inputs, run_ids, "run_ids", initial_soc)
        train = await asyncio.to_thread(self._baseline_inputs, model_id, train_run_ids) if baselines else []
        result = await self._result("comparison", compare_runs, document, runs, list(baselines), train)
        return await asyncio.to_thread(self._keep_comparison, model_id, run_ids, result, initial_soc, campaign_id)

    async def comparison_series(self, comparison_id: str, part: CurvePart) -> bytes:
        """Give a part of the curves behind a comparison as JSON; simulated in a worker when first asked for.

        Raises
        ------
        NotFoundError
            No such comparison.
        BadRequestError
            The samples cannot be compared any more.
        """
        return await self._curves.part(comparison_id, part)

    async def comparison_table(self, comparison_id: str) -> bytes:
        """Give every sample behind a comparison as CSV, see `jobs.modelling.compare_table`; computed in a worker.

        Raises
        ------
        NotFoundError
            No such comparison.
        BadRequestError
            The samples cannot be compared any more.
        """
        document, runs = await asyncio.to_thread(self._series_inputs, comparison_id)
        tables: list[bytes] = []

        def keep(result: dict[str, list[Any]]) -> Json:
            # Kept here and not in the job's record, of which there are hundreds.
            names = {"run": str, "inside": int}
            tables.append(encode_csv({key: np.array(part, names.get(key, float)) for key, part in result.items()}))
            return {"comparison_id": comparison_id}

        await self._ended(self._jobs.submit("series", compare_table, self._data_dir, document, runs, store=keep))
        return tables[0]

    async def soc_figures(self, run: RunRecord) -> SocFigures:
        """Judge a run's live observer by counted charge, see `jobs.modelling.observer_figures`."""
        start = RunInput(run.id, run.initial_soc, run.n_samples, run.sha256)
        return cast(SocFigures, await self._result("observation", observer_figures, start, run.capacity_Ah))

    async def _simulated(self, comparison_id: str) -> Sequence[Curves]:
        document, runs = await asyncio.to_thread(self._series_inputs, comparison_id)
        curves: list[Curves] = []

        def keep(result: dict[str, list[Curves]]) -> Json:
            # Kept here and not in the job's record, of which there are hundreds.
            curves.extend(result["curves"])
            return {"comparison_id": comparison_id}

        queued = self._jobs.submit("series", compare_series, self._data_dir, document, runs, MOST_ROWS, store=keep)
        await self._ended(queued)
        return curves

    def _series_inputs(self, comparison_id: str) -> tuple[Json, list[RunInput]]:
        record = self._store.comparisons.get(comparison_id)
        document = self._store.models.document(record.model_id)
        return document, [run_input(self._store, run_id, record.initial_soc) for run_id in record.run_ids]

    def _baseline_inputs(self, model_id: str, named: Sequence[str] | None) -> list[RunInput]:
        if named is None and not (named := [run.run_id for run in self._store.models.get(model_id).train]):
            raise BadRequestError("the model names no runs to fit baselines to", ("train_run_ids",), remedy="name them")
        return self.inputs(named, "train_run_ids", None)

    async def _result(self, kind: str, function: JobFunction, *arguments: object) -> Json:
        return await self._ended(self._jobs.submit(kind, function, self._data_dir, *arguments))

    async def _ended(self, queued: Job) -> Json:
        job = await self._jobs.wait(queued.id)
        if job.result is None:
            raise BadRequestError(f"the {job.kind} failed: {job.error}")
        return dict(job.result)

    def _keep_comparison(
        self, model_id: str, run_ids: Sequence[str], result: Json, initial_soc: float | None, campaign_id: str | None
    ) -> ComparisonRecord:
        return self._store.comparisons.add(
            model_id,
            self._store.runs.references(run_ids),
            result,
            code_version=self._code_version,
            initial_soc=initial_soc,
            campaign_id=campaign_id,
        )

    def _module_wish(self, order: FitOrder, module: ModuleOrder) -> ModuleWish:
        cell_id = module.cell_model_id
        return {
            "in_series": module.in_series,
            "parallel": module.parallel,
            "cell": None if cell_id is None else self._store.models.document(cell_id),
            "structure": order.structure,
            "without": list(order.without),
            "initial_soc_std": order.initial_soc_std,
            "coulombic_efficiency": order.coulombic_efficiency,
        }

    def _fit_inputs(self, order: FitOrder) -> tuple[list[RunInput], list[RunInput]]:
        validate = self.inputs(order.validate, "validate", None) if order.validate else []
        return self.inputs(order.train, "train", None), validate

    def inputs(self, run_ids: Sequence[str], field: str, initial_soc: float | None) -> list[RunInput]:
        """Look runs up for a worker; `initial_soc` replaces theirs, `field` is what a refusal names.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            A run is not there, has not ended, is named twice, or none is given.
        """
        if not run_ids:
            raise BadRequestError("name at least one run", (field,))
        if len(set(run_ids)) != len(run_ids):
            raise BadRequestError("a run is named twice", (field,))
        return [run_input(self._store, run_id, initial_soc) for run_id in run_ids]
