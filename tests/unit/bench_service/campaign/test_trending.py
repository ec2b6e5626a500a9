"""Orders of a cell's life: lists as long as the runs, each run with its own start, the answer as a table."""

import asyncio
import csv
import io
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from bench_service.campaign.modelling import Modelling
from bench_service.campaign.trending import Trending, TrendOrder, life_csv
from bench_service.errors import BadRequestError, ConflictError, NotFoundError
from bench_service.jobs.runner import Job, JobRunner
from bench_service.jobs.series import RunInput
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent
from tests.unit.bench_service.api.route_rig import Part, run_record

RUN = {
    "run": "r1", "at": 3.0, "capacity_Ah": {"value": 2.5, "std": 0.02}, "slip": {"value": 0.01, "std": 0.02},
    "loop_mV": {"value": 1.0, "std": 2.0}, "resistance": [{"soc": 0.5, "value_Ohm": 0.03, "std_Ohm": 0.001}],
    "verdict": "missing", "findings": [{"effect": "capacity"}, {"effect": "resistance_growth"}],
    "error_mV": 40.0, "unexplained_mV": 4.0,
}  # fmt: skip


class _Models:
    train = (RunInput("t1", 0.5),)
    id = "m1"

    def __init__(self, document: dict[str, Any]) -> None:
        self._document = document

    def get(self, _model_id: str) -> "_Models":
        return self

    def document(self, _model_id: str) -> dict[str, Any]:
        return self._document


class _Parts:
    """A store with one model, runs that start half full, and jobs that keep what they were given."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.models, self.given = _Models(document), list[Any]()
        self.cells: dict[str, str] = {}

    def inputs(self, run_ids: list[str], _field: str, _soc: float | None) -> list[RunInput]:
        return [RunInput(each, 0.5) for each in run_ids]

    @property
    def runs(self) -> Any:
        return SimpleNamespace(get=lambda run_id: run_record(id=run_id, cell_id=self.cells.get(run_id)))

    def submit(self, _kind: str, _function: Any, *arguments: Any, store: Any) -> Job:
        self.given, self.told = list(arguments), store({"runs": []})
        return Job(id="j1", kind="trend")


def submitted(document: dict[str, Any], **order: Any) -> list[Any]:
    parts = _Parts(document)
    trending = Trending(cast(MetadataStore, parts), cast(JobRunner, parts), cast(Modelling, parts), Path("data"))
    asyncio.run(trending.start_trend(TrendOrder(model_id="m1", run_ids=["r1", "r2"], **order)))
    return parts.given


def test_each_run_starts_where_it_is_said_to() -> None:
    _, _, runs, train, along, _ = submitted({}, initial_soc=[0.0, 1.0], at=[1.0, 9.0], unit="cycle", end=0.7)
    assert [run.initial_soc for run in runs] == [0.0, 1.0]
    assert [run.run_id for run in train] == ["t1"]
    assert along == {"at": [1.0, 9.0], "unit": "cycle", "end": 0.7}


def test_a_model_that_knows_its_runs_needs_them_no_more() -> None:
    _, _, runs, train, _, _ = submitted({"record": {"diagnosis": {"kind": "x"}}})
    assert train == [] and [run.initial_soc for run in runs] == [0.5, 0.5]
    assert len(submitted({"record": {"diagnosis": {"kind": "x"}}}, train_run_ids=["t9"])[3]) == 1


@pytest.mark.parametrize("wrong", [{"at": [1.0]}, {"initial_soc": [0.1, 0.2, 0.3]}])
def test_lists_are_as_long_as_the_runs(wrong: dict[str, Any]) -> None:
    with pytest.raises(BadRequestError, match="2 run"):
        submitted({}, **wrong)


def test_a_row_a_run() -> None:
    (row,) = csv.DictReader(io.StringIO(life_csv({"runs": [RUN]})))
    assert (row["run"], row["capacity_Ah"], row["effects"]) == ("r1", "2.5", "capacity resistance_growth")
    assert (row["resistance_Ohm_soc0.50"], row["resistance_std_Ohm_soc0.50"]) == ("0.03", "0.001")


def test_a_table_needs_an_answer() -> None:
    def of(job: Job) -> Trending:
        return Trending(cast(Any, None), cast(JobRunner, Part(get=job)), cast(Any, None), Path("data"))

    assert of(Job(id="j", kind="trend", result={"runs": [RUN]})).table("j").startswith("run,at,")
    with pytest.raises(ConflictError, match="queued"):
        of(Job(id="j", kind="trend")).table("j")
    with pytest.raises(NotFoundError, match="fit"):
        of(Job(id="j", kind="fit")).table("j")


def followed(cells: dict[str, str]) -> Any:
    parts = _Parts({"record": {"diagnosis": {}}})
    parts.cells = cells
    trending = Trending(cast(MetadataStore, parts), cast(JobRunner, parts), cast(Modelling, parts), Path("data"))
    asyncio.run(trending.start_trend(TrendOrder(model_id="m1", run_ids=["r1", "r2"])))
    return parts.told


def test_a_life_is_that_of_one_cell() -> None:
    assert followed({}) == {"runs": [], "cell_id": None, "model_id": "m1"}
    assert followed({"r1": "C1"})["cell_id"] == followed({"r1": "C1", "r2": "C1"})["cell_id"] == "C1"
    with pytest.raises(ConflictError, match="the runs are of several cells: C1, C2"):
        followed({"r1": "C1", "r2": "C2"})


def test_without_runs_it_is_all_that_a_cell_has_completed(tmp_path: Path) -> None:
    with closing(MetadataStore.open(tmp_path)) as store:
        cell = store.cells.add()
        trending = Trending(store, cast(JobRunner, None), cast(Modelling, None), tmp_path)
        with pytest.raises(BadRequestError, match="cell C1 has no completed run"):
            trending._runs_of(TrendOrder(model_id="m1", cell_id="c1"))
        with pytest.raises(BadRequestError, match="name them, or their cell_id"):
            trending._runs_of(TrendOrder(model_id="m1"))
        made = []
        for began_utc in ("2026-02-01", "2026-01-01"):
            intent = RunIntent(bench="import", profile_id=None, dt_s=1.0, initial_soc=0.5, capacity_Ah=2.5, limits={},
                               code_version="1", cell_id=cell.id)  # fmt: skip
            made.append(store.runs.end(store.runs.add(intent).id, "completed", None, n_samples=2, sha256="ab").id)
            store.runs.date(made[-1], began_utc, began_utc, 1.0)
        assert trending._runs_of(TrendOrder(model_id="m1", cell_id="c1")) == (made[::-1], "C1")
