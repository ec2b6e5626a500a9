"""Reports of what is stored: looked up, made here or by a worker, given as HTML or printed as PDF."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench_service.campaign.designing import Designing
from bench_service.campaign.inputs import run_input
from bench_service.campaign.report_headings import heading_of, run_name, run_names
from bench_service.campaign.run_counters import cycles_of
from bench_service.campaign.trending import Trending
from bench_service.errors import BadRequestError
from bench_service.jobs.reporting import report_comparison, report_diagnosis
from bench_service.jobs.runner import JobFunction, JobRunner
from bench_service.jobs.series import RunInput
from bench_service.reports import words
from bench_service.reports.document import Heading, Report, render
from bench_service.reports.pdf import to_pdf
from bench_service.store.integrity import Expected, read_part
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json, RunRecord
from bench_service.store.samples import SampleReader
from bench_service.streams import OBSERVER, SAMPLES

_MOST_EVENTS = 1000


@dataclass(frozen=True, slots=True)
class Made:
    """Where the answers of jobs are: workers simulate what a report draws, and some answers stand nowhere else."""

    jobs: JobRunner
    trending: Trending
    designing: Designing


class Reporting:
    """Writes reports.

    Parameters
    ----------
    store : MetadataStore
    samples : SampleReader
    made : Made
    data_dir : Path
        Where workers read samples.
    version : str
        Of this program.
    """

    def __init__(
        self,
        store: MetadataStore,
        samples: SampleReader,
        made: Made,
        data_dir: Path,
        version: str,
    ) -> None:
        self._store, self._samples, self._jobs = store, samples, made.jobs
        self._trending, self._designing = made.trending, made.designing
        self._data_dir, self._version = data_dir, version
        # A browser takes 200 MB: one at a time.
        self._printer = asyncio.Lock()

    async def printed(self, page: bytes) -> bytes:
        """Turn a page into PDF; raises `NoPrinterError` where nothing here prints."""
        async with self._printer:
            return await asyncio.to_thread(to_pdf, page)

    async def run(self, run_id: str) -> bytes:
        """Write the report of a run; of a damaged one with what is left.

        Raises
        ------
        NotFoundError
            No such run.
        """
        return await asyncio.to_thread(lambda: render(self._run(run_id)))

    async def campaign(self, campaign_id: str) -> bytes:
        """Write the report of a campaign as far as it came; raises `NotFoundError`."""
        return await asyncio.to_thread(lambda: render(self._campaign(campaign_id)))

    async def comparison(self, comparison_id: str) -> bytes:
        """Write the report of a comparison; a worker simulates its curves.

        Raises
        ------
        NotFoundError, BadRequestError
            It is not there, or its samples cannot be compared any more.
        """
        return await self._simulated(report_comparison, *await asyncio.to_thread(self._comparison, comparison_id))

    async def diagnosis(self, diagnosis_id: str) -> bytes:
        """Write the report of a diagnosis; see `comparison`."""
        return await self._simulated(report_diagnosis, *await asyncio.to_thread(self._diagnosis, diagnosis_id))

    async def trend(self, job_id: str) -> bytes:
        """Write the report of a cell's life, as long as its job is known.

        Raises
        ------
        NotFoundError, ConflictError
            There is no such job, it follows no cell, or it has no answer.
        """
        return await asyncio.to_thread(lambda: render(self._trend(job_id)))

    async def design(self, job_id: str) -> bytes:
        """Give the report of a design, which its worker has written; see `trend`."""
        return await asyncio.to_thread(self._designing.report, job_id)

    def _run(self, run_id: str) -> Report:
        # Lazy: numba takes 300 ms; the first use in a service's life pays for it, not its start.
        from bench_service.reports.run import Measured, run_report

        run = self._store.runs.get(run_id)
        data, damage = read_part(self._samples, Expected.of(run), SAMPLES, None, None)
        if run.removed_utc is not None:
            damage = f"they were given up at {words.moment(run.removed_utc)}"
        measured = Measured(
            data.columns,
            self._samples.read(run.id, OBSERVER).columns,
            cycles_of(self._store, self._samples, run.id),
            list(reversed(self._store.events.page(run.id, _MOST_EVENTS))),
            damage,
        )
        more = [("Id", run.id), ("SHA-256", run.sha256 or words.NOTHING)]
        title = run.label or run.name or f"Run {run.id[:8]}"
        heading = heading_of(self._store, "Run", title, [run], run.model_id, more=more)
        return run_report(self._made(replace(heading, more=heading.more[1:])), run, measured)

    def _campaign(self, campaign_id: str) -> Report:
        from bench_service.reports.campaign import campaign_report  # lazy, as above

        record = self._store.campaigns.get(campaign_id)
        result = record.result or {}
        runs = [self._store.runs.get(each["run_id"]) for each in result.get("runs", [])]
        models = [self._store.models.get(each["model"]) for each in result.get("model_chain", [])]
        called = run_names(runs) | {model.id: f"{model.name} ({model.id[:8]})" for model in models}
        more = [("Id", record.id), ("Began", words.moment(record.created_utc))]
        heading = heading_of(self._store, "Campaign", record.name, runs, result.get("model_id"), more=more)
        return campaign_report(self._made(replace(heading, bench=heading.bench or record.bench)), record, called)

    def _comparison(self, comparison_id: str) -> tuple[Json, list[RunInput], Json, Heading, dict[str, str]]:
        record = self._store.comparisons.get(comparison_id)
        runs, model = self._runs(record.run_ids), self._store.models.get(record.model_id)
        more = [("Compared", words.moment(record.created_utc)), ("Id", record.id)]
        title = f"{model.name} against {run_name(runs[0]) if len(runs) == 1 else f'{len(runs)} runs'}"
        heading = heading_of(self._store, "Comparison", title, runs, model.id, record.cell_id, more)
        return self._inputs(model.id, runs, record.initial_soc, record.result, heading)

    def _diagnosis(self, diagnosis_id: str) -> tuple[Json, list[RunInput], Json, Heading, dict[str, str]]:
        record = self._store.diagnoses.get(diagnosis_id)
        runs, model = self._runs(record.run_ids), self._store.models.get(record.model_id)
        learned = words.listed([run_name(run) for run in self._runs(record.train_run_ids)]) or "told by the model"
        more = [("Held against", learned), ("Diagnosed", words.moment(record.created_utc)), ("Id", record.id)]
        what = "What has changed" if record.mode == "change" else "What is missing"
        heading = heading_of(self._store, "Diagnosis", f"{what} in {model.name}", runs, model.id, record.cell_id, more)
        return self._inputs(model.id, runs, record.initial_soc, record.result, heading)

    def _inputs(
        self, model_id: str, runs: Sequence[RunRecord], initial_soc: float | None, result: Json, heading: Heading
    ) -> tuple[Json, list[RunInput], Json, Heading, dict[str, str]]:
        document = self._store.models.document(model_id)
        inputs = [run_input(self._store, run.id, initial_soc) for run in runs]
        return document, inputs, result, self._made(heading), run_names(runs)

    def _trend(self, job_id: str) -> Report:
        from bench_service.reports.life import life_report  # lazy, as above

        result = self._trending.answer(job_id)
        runs = self._runs([each["run"] for each in result["runs"]])
        cell_id = result["cell_id"]
        title = "Life of a cell" if cell_id is None else f"Life of cell {self._store.cells.get(cell_id).called}"
        heading = heading_of(self._store, "Life", title, runs, result["model_id"], cell_id)
        return life_report(self._made(heading), result, run_names(runs))

    def _runs(self, run_ids: Sequence[str]) -> list[RunRecord]:
        return [self._store.runs.get(run_id) for run_id in run_ids]

    def _made(self, heading: Heading) -> Heading:
        return replace(heading, made=words.made_by(self._version))

    async def _simulated(self, function: JobFunction, *inputs: Any) -> bytes:
        pages: list[bytes] = []

        def keep(result: dict[str, bytes]) -> Json:
            # Kept here and not in the job's record, of which there are hundreds.
            pages.append(result["page"])
            return {}

        job = await self._jobs.wait(self._jobs.submit("report", function, self._data_dir, *inputs, store=keep).id)
        if job.result is None:
            raise BadRequestError(f"the report cannot be made: {job.error}")
        return pages[0]
