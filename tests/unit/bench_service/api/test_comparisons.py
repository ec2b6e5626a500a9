"""Comparisons over REST."""

from typing import Any, get_args

import pytest

from bench_service.api import comparisons
from bench_service.campaign.comparison_curves import CurvePart
from bench_service.errors import NotFoundError
from bench_service.store.records import ComparisonRecord
from models.baselines.beside import BASELINES
from tests.unit.bench_service.api.route_rig import MOMENT, REFERENCE, AsyncPart, Store, client_of, error_of

RECORD = ComparisonRecord(
    id="k1",
    model_id="m1",
    runs=(REFERENCE,),
    initial_soc=None,
    result={"overall": {"rmse_mV": 3.0}},
    created_utc=MOMENT,
    campaign_id=None,
    code_version="1",
)


def test_a_comparison_is_answered_when_it_is_done() -> None:
    modelling = AsyncPart(compare=RECORD)
    client = client_of(comparisons.router, modelling=modelling)
    answer = client.post("/comparisons", json={"model_id": "m1", "run_ids": ["r1"], "initial_soc": 0.5})
    assert answer.status_code == 201
    assert modelling.calls == [("compare", ("m1", ["r1"], 0.5), {"baselines": [], "train_run_ids": None})]
    # Ids for those who want no more, references with hashes for those who check.
    assert answer.json()["run_ids"] == ["r1"]
    assert answer.json()["runs"] == [{"run_id": "r1", "sha256": "abc"}]
    assert answer.json()["result"] == {"overall": {"rmse_mV": 3.0}}


def test_baselines_are_handed_on_with_the_runs_that_they_learn_from() -> None:
    modelling = AsyncPart(compare=RECORD)
    client = client_of(comparisons.router, modelling=modelling)
    body = {"model_id": "m1", "run_ids": ["r1"], "baselines": ["1rc", "esc"], "train_run_ids": ["r2"]}
    assert client.post("/comparisons", json=body).status_code == 201
    asked = {"baselines": ["1rc", "esc"], "train_run_ids": ["r2"]}
    assert modelling.calls == [("compare", ("m1", ["r1"], None), asked)]


def test_the_baselines_that_can_be_asked_for_are_those_that_there_are() -> None:
    assert get_args(comparisons.Baseline) == tuple(BASELINES)


@pytest.mark.parametrize(
    "changes",
    [
        {"run_ids": []},
        {"run_ids": ["r"] * 101},
        {"run_ids": [1]},
        {"initial_soc": 1.01},
        {"model_id": ""},
        {"seed": 1},
        {"baselines": ["3rc"]},
        {"baselines": ["1rc"], "train_run_ids": []},
        {"train_run_ids": ["r2"]},
    ],
)
def test_a_body_that_asks_for_nothing_or_too_much_is_refused(changes: dict[str, Any]) -> None:
    modelling = AsyncPart(compare=RECORD)
    client = client_of(comparisons.router, modelling=modelling)
    answer = client.post("/comparisons", json={"model_id": "m1", "run_ids": ["r1"]} | changes)
    assert answer.status_code == 422 and error_of(answer)["where"][0] in changes
    assert modelling.calls == []


def test_pages_of_all_models_or_of_one() -> None:
    store = Store(comparisons={"page": [RECORD]})
    client = client_of(comparisons.router, store=store)
    assert client.get("/comparisons").json()["comparisons"][0]["run_ids"] == ["r1"]
    client.get("/comparisons?model_id=m1&limit=5&offset=2")
    assert [(*said, *named.values()) for _, said, named in store.calls] == [
        (None, None, 101, 0, None),
        ("m1", None, 6, 2, None),
    ]


def test_one_that_is_not_there_is_404() -> None:
    store = Store(comparisons={"get": NotFoundError.of("comparison", "k9")})
    assert client_of(comparisons.router, store=store).get("/comparisons/k9").status_code == 404


def test_curves_are_handed_on_as_the_worker_wrote_them() -> None:
    text = b'{"runs":[{"run_id":"r1","time_s":[0]}]}'
    modelling = AsyncPart(comparison_series=text)
    client = client_of(comparisons.router, modelling=modelling)
    answer = client.get("/comparisons/k1/series?max_points=50")
    assert (answer.content, answer.headers["content-type"]) == (text, "application/json")
    client.get("/comparisons/k1/series")
    client.get("/comparisons/k1/series?from_s=10&to_s=20.5&points=70")
    parts = [("k1", CurvePart(points=50)), ("k1", CurvePart()), ("k1", CurvePart(10.0, 20.5, 70))]
    assert [arguments for _, arguments, _ in modelling.calls] == parts
    assert client.get("/comparisons/k1/series?from_s=3&to_s=2").status_code == 422


@pytest.mark.parametrize("points", ["1", "20001", "many"])
def test_curves_have_a_number_of_points_that_can_be_drawn(points: str) -> None:
    modelling = AsyncPart(comparison_series=b"{}")
    client = client_of(comparisons.router, modelling=modelling)
    assert client.get(f"/comparisons/k1/series?max_points={points}").status_code == 422


def test_every_sample_is_given_as_a_file() -> None:
    table = b"run,time_s,inside\nr1,0,1\n"
    modelling = AsyncPart(comparison_table=table)
    answer = client_of(comparisons.router, modelling=modelling).get("/comparisons/k1/series.csv")
    assert answer.content == table and answer.headers["content-type"].startswith("text/csv")
    assert "comparison.csv" in answer.headers["content-disposition"]
    assert modelling.calls == [("comparison_table", ("k1",), {})]
