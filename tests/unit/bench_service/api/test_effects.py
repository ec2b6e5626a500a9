"""Effects and versions of a model over REST."""

from typing import Any

import pytest

from bench_service.api import effects
from bench_service.errors import NotFoundError
from bench_service.jobs.runner import Job
from models.effects import effects as known_effects
from tests.unit.bench_service.api.route_rig import AsyncPart, Store, client_of, error_of

JOB = Job(id="j1", kind="effect")


def test_every_effect_is_listed_with_how_a_person_recognises_it() -> None:
    listed = client_of(effects.router).get("/effects").json()["effects"]
    assert {each["name"] for each in listed} == set(known_effects())
    for each in listed:
        assert each["recognise"] == known_effects()[each["name"]].recognise


def test_an_effect_is_added_with_the_parents_runs_where_none_are_named() -> None:
    diagnosing = AsyncPart(start_addition=JOB)
    client = client_of(effects.router, diagnosing=diagnosing)
    answer = client.post("/models/m1/effects", json={"effect": "hysteresis"})
    assert (answer.status_code, answer.json()["id"]) == (202, "j1")
    both = {"effect": "hysteresis", "train_run_ids": ["r1"], "validate_run_ids": ["r2"]}
    client.post("/models/m1/effects", json=both)
    assert [arguments for _, arguments, _ in diagnosing.calls] == [
        ("m1", "hysteresis", None, None),
        ("m1", "hysteresis", ["r1"], ["r2"]),
    ]


@pytest.mark.parametrize(
    "body", [{}, {"effect": ""}, {"effect": "x", "train_run_ids": []}, {"effect": "x", "validate_run_ids": ["r"] * 101}]
)
def test_an_effect_without_a_name_or_with_no_runs_is_refused(body: dict[str, Any]) -> None:
    diagnosing = AsyncPart(start_addition=JOB)
    assert client_of(effects.router, diagnosing=diagnosing).post("/models/m1/effects", json=body).status_code == 422
    assert diagnosing.calls == []


def test_a_refit_needs_runs() -> None:
    diagnosing = AsyncPart(start_refit=JOB)
    client = client_of(effects.router, diagnosing=diagnosing)
    assert client.post("/models/m1/refit", json={"train_run_ids": ["r1"]}).status_code == 202
    assert diagnosing.calls == [("start_refit", ("m1", ["r1"], None), {})]
    for body in ({}, {"train_run_ids": None}, {"train_run_ids": []}):
        refused = client.post("/models/m1/refit", json=body)
        assert (refused.status_code, error_of(refused)["where"]) == (422, ["train_run_ids"])


def test_versions_of_a_model_that_is_not_there_are_404() -> None:
    store = Store(models={"family": NotFoundError.of("model", "m9")})
    answer = client_of(effects.router, store=store).get("/models/m9/chain")
    assert (answer.status_code, error_of(answer)["message"]) == (404, "unknown model 'm9'")


def test_a_model_learns_from_runs_in_their_order() -> None:
    learning = AsyncPart(start_learning=JOB)
    client = client_of(effects.router, learning=learning)
    assert client.post("/models/m1/learn", json={"run_ids": ["r2", "r1"]}).status_code == 202
    body = {"run_ids": ["r1"], "validate_run_ids": ["r3"]}
    client.post("/models/m1/learn", json=body)
    first, second = (arguments[0] for _, arguments, _ in learning.calls)
    assert (first.model_id, list(first.run_ids), list(first.validate_run_ids)) == ("m1", ["r2", "r1"], [])
    assert list(second.validate_run_ids) == ["r3"]
    for wrong in ({}, {"run_ids": []}, {"run_ids": ["r1"], "memory_s": 1}):
        assert client.post("/models/m1/learn", json=wrong).status_code == 422
