"""Reports of what is stored: whose they are, and that nobody is called by an id alone."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.campaign.designing import Designing
from bench_service.campaign.report_headings import design_heading, heading_of
from bench_service.campaign.reporting import Made, Reporting
from bench_service.errors import BadRequestError, ConflictError, NotFoundError
from bench_service.jobs.designing import design_profile
from bench_service.jobs.reporting import report_comparison, report_diagnosis
from bench_service.jobs.runner import Job
from bench_service.jobs.series import RunInput
from bench_service.reports import words
from bench_service.reports.document import Heading
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import ModelOrigin, RunIntent
from bench_service.store.samples import SampleReader
from models.comparison.figures import compare
from tests.unit.bench_service.api.route_rig import Part
from tests.unit.bench_service.reports.hand_result import NETWORK, RUN, SOC
from tests.unit.bench_service.reports.test_diagnosis import answer as diagnosed
from tests.unit.bench_service.reports.test_life import entry


@pytest.fixture
def store(tmp_path: Path) -> Iterator[MetadataStore]:
    with closing(MetadataStore.open(tmp_path)) as opened:
        yield opened


class Jobs:
    """Ends every job at once with what a test says."""

    def __init__(self, *known: Job, page: bytes | None = None) -> None:
        self.known, self.page = {job.id: job for job in known}, page
        self.asked: list[tuple[Any, ...]] = []

    def submit(self, kind: str, function: Any, *arguments: Any, store: Any) -> Job:
        self.asked.append((function, *arguments))
        result = None if self.page is None else store({"page": self.page})
        job = Job(f"{kind}-1", kind, "done" if self.page else "failed", result=result, error="too few samples")
        self.known[job.id] = job
        return job

    async def wait(self, job_id: str) -> Job:
        return self.known[job_id]

    def get(self, job_id: str) -> Job:
        return self.known[job_id]


def filled(store: MetadataStore) -> tuple[str, str]:
    """A run of a cell, and a model made from it."""
    cell = store.cells.add(label="left", owner="Ana", type={"maker": "LG", "model": "M50"})
    profile = store.profiles.add("p", np.array([0.0, 50.0]), np.array([1.0, 0.0]))
    intent = RunIntent(bench="rig", profile_id=profile.id, dt_s=1.0, initial_soc=0.5, capacity_Ah=2.5, limits={},
                       code_version="1", cell_id=cell.id, name="first")  # fmt: skip
    run = store.runs.add(intent)
    store.runs.start(run.id)
    store.runs.end(run.id, "completed", None, n_samples=0, missed_ticks=0, sha256="ab")
    store.runs.describe(run.id, {"operator": "Bo"})
    origin = ModelOrigin(name="net", structure="auto", capacity_Ah=2.5, code_version="1",
                         train=store.runs.references([run.id]))  # fmt: skip
    return run.id, store.models.add({"kind": "network"}, origin).id


def reporting(store: MetadataStore, folder: Path, jobs: Any, **parts: Any) -> Reporting:
    made = Made(jobs, parts.get("trending"), parts.get("designing"))  # pyright: ignore[reportArgumentType]
    return Reporting(store, SampleReader(folder), made, folder, "0.1")


def test_a_heading_says_which_cell_where_by_whom_and_with_which_model(store: MetadataStore) -> None:
    run_id, model_id = filled(store)
    heading = heading_of(store, "Run", "t", [store.runs.get(run_id)], model_id)
    assert (heading.cell, heading.bench, heading.operator) == ("C1 (left), LG M50; owner: Ana", "rig", "Bo")
    assert (heading.model or "").startswith(f"net ({model_id[:8]}), made 20")
    assert heading.dates and "UTC" in heading.dates and heading.more == [("Run", f"first ({run_id[:8]})")]
    assert design_heading(store, "next", None).model == "none yet"
    assert "C1" in (design_heading(store, "next", model_id).cell or "")


def test_a_file_without_a_date_was_measured_nobody_knows_when(store: MetadataStore) -> None:
    run_id, _ = filled(store)
    run = store.runs.get(run_id)
    undated = replace(run, bench="import", started_utc=None)
    heading = heading_of(store, "Run", "t", [undated])
    assert heading.dates == f"brought in {words.moment(run.created_utc)}, its file has no date"
    assert heading.bench == "none of this service: brought in from a file"
    assert "; brought in" in (heading_of(store, "Life", "t", [run, undated]).dates or "")


def test_a_run_without_samples_and_a_campaign_that_failed_have_reports(store: MetadataStore, tmp_path: Path) -> None:
    run_id, _ = filled(store)
    part = reporting(store, tmp_path, Jobs())
    text = asyncio.run(part.run(run_id)).decode()
    assert "C1 (left)" in text and "No sample is stored." in text and run_id in text
    with pytest.raises(NotFoundError):
        asyncio.run(part.campaign("none"))


def test_curves_are_left_to_a_worker_which_is_told_what_people_call_the_runs(
    store: MetadataStore, tmp_path: Path
) -> None:
    run_id, model_id = filled(store)
    references = store.runs.references([run_id])
    comparison = store.comparisons.add(model_id, references, {"overall": {}}, code_version="1")
    diagnosis = store.diagnoses.add(model_id, references, {"verdict": "x"}, mode="change", code_version="1")
    jobs = Jobs(page=b"page")
    part = reporting(store, tmp_path, jobs)
    assert asyncio.run(part.comparison(comparison.id)) == asyncio.run(part.diagnosis(diagnosis.id)) == b"page"
    (compared, diagnosed_call) = jobs.asked
    assert compared[0] is report_comparison and diagnosed_call[0] is report_diagnosis
    assert compared[-1] == {run_id: f"first ({run_id[:8]})"} and compared[-2].kind == "Comparison"
    assert diagnosed_call[-2].title == "What has changed in net"
    with pytest.raises(BadRequestError, match="too few samples"):
        asyncio.run(reporting(store, tmp_path, Jobs()).comparison(comparison.id))


def test_a_life_is_told_of_the_job_that_followed_it(store: MetadataStore, tmp_path: Path) -> None:
    run_id, model_id = filled(store)
    result = {"runs": [entry(run_id)], "cell_id": "C1", "model_id": model_id}
    part = reporting(store, tmp_path, Jobs(), trending=Part(answer=result))
    text = asyncio.run(part.trend("j1")).decode()
    assert "Life of cell C1 (left)" in text and f"first ({run_id[:8]})" in text


def test_the_report_of_a_design_is_kept_as_long_as_there_is_room(store: MetadataStore, tmp_path: Path) -> None:
    request = {"capacity_Ah": 2.0, "duration_s": 20000.0, "limits": {"current_A": [-4, 4], "soc": [0.1, 0.9]}}
    found = design_profile(lambda *_: None, tmp_path, request, None, [], None, (), Heading("Design", "first"))  # pyright: ignore[reportArgumentType]
    page = found.get("page")
    assert page is not None and b"bounded pre-test" in page and b"<figure>" in page
    done = Job("j1", "design", "done", result={"profile_id": "p1"})
    jobs = Jobs(done, Job("j2", "design"), Job("j3", "fit"))
    designing = Designing(store, jobs, tmp_path)  # pyright: ignore[reportArgumentType]
    part = reporting(store, tmp_path, jobs, designing=designing)
    for job_id, error in (("j1", NotFoundError), ("j2", ConflictError), ("j3", NotFoundError)):
        with pytest.raises(error):
            asyncio.run(part.design(job_id))


def test_workers_write_whole_pages(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("bench_service.jobs.reporting.read_series", lambda *_: [RUN])
    inputs = (lambda *_: None, tmp_path, NETWORK.to_json(), [RunInput("r", SOC)])
    result = dict(compare(NETWORK, [RUN], [SOC]))
    compared = report_comparison(*inputs, result, Heading("Comparison", "t"), {RUN.name: "the first"})  # pyright: ignore[reportArgumentType]
    diagnosis = report_diagnosis(*inputs, diagnosed(), Heading("Diagnosis", "t"), {RUN.name: "the first"})  # pyright: ignore[reportArgumentType]
    for page in (compared["page"], diagnosis["page"]):
        assert b"Run the first" in page and page.endswith(b"</html>")
