"""What has become of a cell over its runs: inputs looked up, work handed to a worker, its answer as a table."""

from __future__ import annotations

import asyncio
import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench_service.campaign.cell_of_run import cell_of_all
from bench_service.campaign.modelling import Modelling
from bench_service.errors import BadRequestError, ConflictError, NotFoundError
from bench_service.jobs.runner import Job, JobRunner
from bench_service.jobs.series import RunInput
from bench_service.jobs.trending import follow_runs
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json

KIND = "trend"
MOST_RUNS = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class TrendOrder:
    """Runs of a cell in time's order, to be followed with a model of the cell as it was.

    `run_ids`: None: every run of `cell_id` that was completed. `train_run_ids`: those that the model was made from;
    None: as the model says. `initial_soc`: one for each run, a fraction of what the cell holds then; None: as stored.
    `at`, `unit`: places along the life; None: runs are counted. `end`: share of the capacity that is the end.
    """

    model_id: str
    run_ids: Sequence[str] | None = None
    cell_id: str | None = None
    train_run_ids: Sequence[str] | None = None
    initial_soc: Sequence[float] | None = None
    initial_soc_std: float | None = None
    at: Sequence[float] | None = None
    unit: str = "run"
    end: float = 0.8


class Trending:
    """Follows cells over their lives.

    Parameters
    ----------
    store : MetadataStore
    jobs : JobRunner
    modelling : Modelling
        Looks runs up.
    data_dir : Path
        Where workers read samples.
    """

    def __init__(self, store: MetadataStore, jobs: JobRunner, modelling: Modelling, data_dir: Path) -> None:
        self._store, self._jobs, self._modelling, self._data_dir = store, jobs, modelling, data_dir

    async def start_trend(self, order: TrendOrder) -> Job:
        """Queue it; the job's result is the ``trend`` object of the public contract, with ``cell_id`` and ``model_id``.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
            Model or run are not there, a run has not ended or is named twice, the runs are of several cells, or lists
            are not as long as the runs.
        """
        run_ids, cell_id = await asyncio.to_thread(self._runs_of, order)
        for name in ("initial_soc", "at"):
            given = getattr(order, name)
            if given is not None and len(given) != len(run_ids):
                told = f"{len(given)} value(s) for {len(run_ids)} run(s)"
                raise BadRequestError(told, (name,), remedy="give one for each run, or leave it out")
        document, runs, train = await asyncio.to_thread(self._inputs, order, run_ids)
        along = {"at": None if order.at is None else list(order.at), "unit": order.unit, "end": order.end}
        told = {"cell_id": cell_id, "model_id": order.model_id}
        inputs = (self._data_dir, document, runs, train, along, order.initial_soc_std)
        return self._jobs.submit(KIND, follow_runs, *inputs, store=lambda found: {**found, **told})

    def table(self, job_id: str) -> str:
        """Give the answer of a job as CSV, a row a run; see `answer`."""
        return life_csv(self.answer(job_id))

    def answer(self, job_id: str) -> Mapping[str, Any]:
        """Give the answer of a job.

        Raises
        ------
        NotFoundError
            There is no such job, or it is none of these.
        ConflictError
            It has no answer.
        """
        job = self._jobs.get(job_id)
        if job.kind != KIND:
            raise NotFoundError(f"job {job_id} follows no cell: it is a {job.kind}")
        if job.result is None:
            raise ConflictError(f"job {job_id} is {job.state}; its answer is not there", ("job",))
        return job.result

    def _runs_of(self, order: TrendOrder) -> tuple[list[str], str | None]:
        """Return the runs to be followed, in time's order, and the cell that they are of."""
        if order.run_ids is not None:
            return list(order.run_ids), order.cell_id or cell_of_all(self._store, list(order.run_ids))
        if order.cell_id is None:
            raise BadRequestError("which runs are to be followed?", ("run_ids",), remedy="name them, or their cell_id")
        cell = self._store.cells.get(order.cell_id)
        runs = self._store.runs.page(state="completed", cell_id=cell.id, limit=MOST_RUNS)
        found = sorted((run for run in runs if run.n_samples), key=lambda run: run.started_utc or run.created_utc)
        if not found:
            raise BadRequestError(f"cell {cell.called} has no completed run to follow", ("cell_id",))
        return [run.id for run in found], cell.id

    def _inputs(self, order: TrendOrder, run_ids: list[str]) -> tuple[Json, list[RunInput], list[RunInput]]:
        model = self._store.models.get(order.model_id)
        document = self._store.models.document(model.id)
        runs = self._modelling.inputs(run_ids, "run_ids", None)
        if order.initial_soc is not None:
            runs = [replace(run, initial_soc=soc) for run, soc in zip(runs, order.initial_soc, strict=True)]
        # A model that tells what it knows of its runs needs them no more.
        own = [] if document.get("record", {}).get("diagnosis") else [run.run_id for run in model.train]
        named = own if order.train_run_ids is None else list(order.train_run_ids)
        train = self._modelling.inputs(named, "train_run_ids", None) if named else []
        return document, runs, train


def life_csv(result: Mapping[str, Any]) -> str:
    """Write the `trend` object as CSV: a row a run, resistances by their SoC in columns."""
    places = sorted({round(each["soc"], 3) for run in result["runs"] for each in run["resistance"]})
    heads = ["run", "at", "capacity_Ah", "capacity_std_Ah", "slip", "slip_std", "loop_mV", "loop_std_mV"]
    heads += ["verdict", "effects", "error_mV", "unexplained_mV"]
    heads += [f"resistance_{kind}Ohm_soc{soc:.2f}" for soc in places for kind in ("", "std_")]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(heads)
    for run in result["runs"]:
        told = {round(each["soc"], 3): (each["value_Ohm"], each["std_Ohm"]) for each in run["resistance"]}
        pairs = [run[name][key] for name in ("capacity_Ah", "slip", "loop_mV") for key in ("value", "std")]
        effects = " ".join(finding["effect"] for finding in run["findings"])
        row = [run["run"], run["at"], *pairs, run["verdict"], effects, run["error_mV"], run["unexplained_mV"]]
        writer.writerow(row + [value for soc in places for value in told.get(soc, ("", ""))])
    return out.getvalue()
