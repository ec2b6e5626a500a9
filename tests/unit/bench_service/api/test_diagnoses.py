"""Diagnoses over REST."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench_service.api import diagnoses
from bench_service.campaign.diagnosing import DiagnosisOrder
from bench_service.jobs.runner import Job
from bench_service.store.diagnoses import DiagnosisRecord
from tests.unit.bench_service.api.route_rig import (
    MOMENT,
    REFERENCE,
    AsyncPart,
    Part,
    Store,
    client_of,
    error_of,
    run_record,
)

JOB = Job(id="j1", kind="diagnosis")
RECORD = DiagnosisRecord(
    id="d1",
    model_id="m1",
    runs=(REFERENCE,),
    train=(),
    mode="change",
    initial_soc=None,
    result={"verdict": "nothing_missing"},
    created_utc=MOMENT,
    campaign_id=None,
    code_version="1",
)
BODY = {"model_id": "m1", "run_ids": ["r1"]}


def test_a_structure_is_asked_for_where_nobody_says_what() -> None:
    diagnosing = AsyncPart(start_diagnosis=JOB)
    answer = client_of(diagnoses.router, diagnosing=diagnosing).post("/diagnoses", json=BODY)
    assert (answer.status_code, answer.json()["id"]) == (202, "j1")
    order = DiagnosisOrder(model_id="m1", run_ids=["r1"], train_run_ids=None, mode="structure")
    assert diagnosing.calls == [("start_diagnosis", (order,), {})]


def test_no_training_runs_are_not_the_models_own() -> None:
    """An empty list says that there are none; leaving it out leaves them to the model."""
    diagnosing = AsyncPart(start_diagnosis=JOB)
    client_of(diagnoses.router, diagnosing=diagnosing).post("/diagnoses", json=BODY | {"train_run_ids": []})
    assert diagnosing.calls[0][1][0].train_run_ids == []


@pytest.mark.parametrize(
    "changes", [{"mode": "both"}, {"run_ids": []}, {"train_run_ids": ["r"] * 101}, {"initial_soc": -0.1}, {"x": 1}]
)
def test_what_is_none_is_refused(changes: dict[str, Any]) -> None:
    diagnosing = AsyncPart(start_diagnosis=JOB)
    answer = client_of(diagnoses.router, diagnosing=diagnosing).post("/diagnoses", json=BODY | changes)
    assert answer.status_code == 422 and error_of(answer)["where"][0] in changes
    assert diagnosing.calls == []


def test_stored_ones_are_given_with_the_ids_of_their_runs() -> None:
    store = Store(diagnoses={"page": [RECORD], "get": RECORD})
    client = client_of(diagnoses.router, store=store)
    (one,) = client.get("/diagnoses?model_id=m1&limit=1").json()["diagnoses"]
    assert (one["run_ids"], one["train_run_ids"], one["result"]) == (["r1"], [], {"verdict": "nothing_missing"})
    assert client.get("/diagnoses/d1").json() == one
    assert [(name, arguments) for name, arguments, _ in store.calls] == [
        ("diagnoses.page", ("m1",)),
        ("diagnoses.get", ("d1",)),
    ]


def experiment(body: dict[str, Any], *, simulated: bool = False, played: bool = False) -> tuple[Any, AsyncPart]:
    """Ask for the next experiment on a bench whose last run, if any, has taken a tenth of the charge out."""
    config = SimpleNamespace(simulate=SimpleNamespace(initial_soc=0.9) if simulated else None)
    bench = SimpleNamespace(
        name="sim",
        sampled_limits="the bench's limits",
        config=config,
        runs_before_cell=0,
        cell=None,
        cell_since_utc=None,
    )
    time_s = np.array([0.0, 360.0])
    data = SimpleNamespace(n=2, gaps=(), columns={"time_s": time_s, "current_A": np.array([0.0, -2.0])})
    diagnosing = AsyncPart(start_experiment=JOB)
    client = client_of(
        diagnoses.router,
        benches=Part(get=bench),
        store=Store(runs={"page": [run_record(n_samples=2)] if played else []}),
        samples=Part(read=data),
        diagnosing=diagnosing,
    )
    return client.post("/diagnoses/d1/experiment", json=body), diagnosing


@pytest.mark.parametrize(
    ("body", "simulated", "played", "soc"),
    [
        ({"initial_soc": 0.3}, True, True, 0.3),  # what a client says counts first
        ({}, True, True, 0.4),  # then where the last run has left the cell
        ({}, True, False, 0.9),  # then where a simulated one begins
    ],
)
def test_the_next_experiment_begins_where_the_cell_stands(
    body: dict[str, Any], simulated: bool, played: bool, soc: float
) -> None:
    answer, diagnosing = experiment({"bench": "sim"} | body, simulated=simulated, played=played)
    assert answer.status_code == 202
    ((_, (diagnosis_id, limits, found), _),) = diagnosing.calls
    assert (diagnosis_id, limits) == ("d1", "the bench's limits")
    assert found == pytest.approx(soc)


def test_of_a_real_cell_somebody_has_to_know() -> None:
    answer, diagnosing = experiment({"bench": "sim"})
    assert (answer.status_code, error_of(answer)["where"]) == (422, ["initial_soc"])
    assert diagnosing.calls == []


def test_regions_of_a_comparison_are_made_by_a_worker() -> None:
    diagnosing = AsyncPart(where={"regions": []})
    assert client_of(diagnoses.router, diagnosing=diagnosing).get("/comparisons/k1/where").json() == {"regions": []}
    assert diagnosing.calls == [("where", ("k1",), {})]
