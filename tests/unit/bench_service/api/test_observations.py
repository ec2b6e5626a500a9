"""Observations over REST."""

from typing import Any

import pytest

from bench_service.api import observations
from bench_service.campaign.observing import ObservationOrder
from bench_service.jobs.runner import Job
from tests.unit.bench_service.api.route_rig import AsyncPart, client_of, error_of

JOB = Job(id="j1", kind="observation")
BODY = {"model_id": "m1", "run_ids": ["r1", "r2"]}


@pytest.mark.parametrize("given", [{}, {"gain": "steady"}, {"gain": "kalman", "initial_soc": 0.3}])
def test_an_order_goes_on_as_it_was_given(given: dict[str, Any]) -> None:
    observing = AsyncPart(start_observation=JOB)
    answer = client_of(observations.router, observing=observing).post("/observations", json=BODY | given)
    assert (answer.status_code, answer.json()["id"]) == (202, "j1")
    order = ObservationOrder(model_id="m1", run_ids=["r1", "r2"], **given)
    assert observing.calls == [("start_observation", (order,), {})]


@pytest.mark.parametrize("changes", [{"run_ids": []}, {"gain": "best"}, {"initial_soc": 1.2}, {"x": 1}])
def test_what_is_none_is_refused(changes: dict[str, Any]) -> None:
    observing = AsyncPart(start_observation=JOB)
    answer = client_of(observations.router, observing=observing).post("/observations", json=BODY | changes)
    assert answer.status_code == 422 and error_of(answer)["where"][0] in changes
    assert observing.calls == []
