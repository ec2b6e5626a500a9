"""Models over REST."""

import json
from typing import Any

import pytest

from bench_service.api import models
from bench_service.api.strict import MAX_BODY_BYTES
from bench_service.campaign.modelling import FitOrder, ModuleOrder
from bench_service.jobs.runner import Job
from bench_service.store.records import ModelRecord
from models.data.errors import ModelError
from tests.unit.bench_service.api.route_rig import MOMENT, REFERENCE, AsyncPart, Part, Store, client_of, error_of

RECORD = ModelRecord(
    id="m1",
    name="one",
    structure="minimal",
    capacity_Ah=2.0,
    seed=None,
    parent_id=None,
    train=(REFERENCE,),
    validate=(),
    metrics=None,
    sha256="abc",
    created_utc=MOMENT,
    campaign_id=None,
    code_version="1",
)
FIT = {"name": "one", "train": ["r1"], "capacity_Ah": 2.0}


def fitted(changes: dict[str, Any]) -> tuple[Any, AsyncPart]:
    modelling = AsyncPart(start_fit=Job(id="j1", kind="fit"))
    return client_of(models.router, modelling=modelling).post("/models", json=FIT | changes), modelling


def test_a_fit_is_ordered_and_a_job_comes_back() -> None:
    answer, modelling = fitted({"validate": ["r2"], "structure": "bounded", "without": ["hysteresis"], "seed": 5})
    assert (answer.status_code, answer.json()["id"]) == (202, "j1")
    given: Any = {"structure": "bounded", "without": ["hysteresis"], "seed": 5}
    order = FitOrder(name="one", train=["r1"], validate=["r2"], capacity_Ah=2.0, **given)
    assert modelling.calls == [("start_fit", (order,), {})]


def test_what_is_left_out_of_a_fit() -> None:
    _, modelling = fitted({})
    order = modelling.calls[0][1][0]
    assert (order.structure, list(order.validate), order.seed) == ("auto", [], None)
    assert list(order.without) == []
    assert (order.initial_soc_std, order.coulombic_efficiency) == (0.0, 1.0)


def test_the_runs_of_a_fit_may_be_of_a_module() -> None:
    for given in ({}, {"in_series": 6, "parallel": 2}, {"cell_model_id": "m0"}):
        assert fitted({"module": given})[1].calls[0][1][0].module == ModuleOrder(**given)
    assert fitted({})[1].calls[0][1][0].module is None
    for wrong in ({"in_series": 0}, {"parallel": "2"}, {"cells": 6}):
        assert fitted({"module": wrong})[0].status_code == 422


def test_a_fit_may_doubt_where_its_runs_begin_and_lose_charge() -> None:
    _, modelling = fitted({"initial_soc_std": 0.05, "coulombic_efficiency": 0.98})
    order = modelling.calls[0][1][0]
    assert (order.initial_soc_std, order.coulombic_efficiency) == (0.05, 0.98)


@pytest.mark.parametrize(
    "changes",
    [
        {"train": []},
        {"train": ["r"] * 101},
        {"capacity_Ah": 0},
        {"capacity_Ah": "2"},
        {"initial_soc_std": 1.5},
        {"coulombic_efficiency": 0},
        {"coulombic_efficiency": 1.1},
        {"structure": "deep"},
        {"without": [""]},
        {"without": "hysteresis"},
        {"seed": -1},
        {"validation": ["r2"]},
    ],
)
def test_a_fit_that_cannot_be_is_refused(changes: dict[str, Any]) -> None:
    answer, modelling = fitted(changes)
    assert answer.status_code == 422 and error_of(answer)["where"][0] in changes
    assert modelling.calls == []


def test_an_import_may_be_large_and_is_called_as_the_query_says() -> None:
    modelling = Part(import_model=RECORD)
    client = client_of(models.router, models.bulk_router, modelling=modelling)
    document = {"theta": "0" * (MAX_BODY_BYTES + 1)}
    assert client.post("/models/import?name=mine", json=document).status_code == 201
    client.post("/models/import", json={})
    assert [arguments for _, arguments, _ in modelling.calls] == [(document, "mine", None), ({}, "imported", None)]


def test_what_is_no_model_is_refused_with_its_reason() -> None:
    modelling = Part(import_model=ModelError("not a network"))
    client = client_of(models.bulk_router, modelling=modelling)
    answer = client.post("/models/import", json={})
    assert (answer.status_code, error_of(answer)["message"]) == (422, "not a network")
    for text in ("[]", '{"a": NaN}', "null"):
        refused = client.post("/models/import", content=text, headers={"content-type": "application/json"})
        assert refused.status_code == 422
    assert client.post("/models/import?name=", json={}).status_code == 422


def test_stored_ones_are_listed_given_and_read_out() -> None:
    store = Store(models={"page": [RECORD], "get": RECORD, "document": {"kind": "network"}})
    modelling = AsyncPart(tables={"ocv": {}})
    client = client_of(models.router, store=store, modelling=modelling)
    (one,) = client.get("/models?limit=2").json()["models"]
    assert one == client.get("/models/m1").json() == json.loads(json.dumps(one))
    assert one["train"] == [{"run_id": "r1", "sha256": "abc"}] and one["metrics"] is None
    assert client.get("/models/m1/document").json() == {"kind": "network"}
    assert client.get("/models/m1/tables").json() == {"ocv": {}}
    assert [(name, arguments) for name, arguments, _ in store.calls] == [
        ("models.page", ()),
        ("models.get", ("m1",)),
        ("models.document", ("m1",)),
    ]
