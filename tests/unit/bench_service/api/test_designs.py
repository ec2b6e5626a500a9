"""Designs over REST."""

from typing import Any

import pytest

from bench_service.api import designs
from bench_service.errors import BadRequestError
from bench_service.jobs.runner import Job
from tests.unit.bench_service.api.route_rig import AsyncPart, client_of, error_of

JOB = Job(id="j1", kind="design", state="queued")


def test_a_request_goes_on_as_it_stands_and_a_job_comes_back() -> None:
    designing = AsyncPart(start=JOB)
    request = {"capacity_Ah": 2.0, "limits": {"current_A": [-2, 2]}, "rivals": ["hysteresis", "relaxation"]}
    answer = client_of(designs.router, designing=designing).post("/designs", json={"name": "d", "request": request})
    assert (answer.status_code, answer.json()["id"], answer.json()["state"]) == (202, "j1", "queued")
    assert designing.calls == [("start", ("d", request), {"report": True})]


@pytest.mark.parametrize(
    ("body", "where"),
    [
        ({"name": "d"}, "request"),
        ({"request": {}}, "name"),
        ({"name": "d", "request": []}, "request"),
        ({"name": "two\nlines", "request": {}}, "name"),
        ({"name": "d", "request": {}, "seed": 1}, "seed"),
    ],
)
def test_a_body_that_is_none_is_refused(body: dict[str, Any], where: str) -> None:
    designing = AsyncPart(start=JOB)
    answer = client_of(designs.router, designing=designing).post("/designs", json=body)
    assert (answer.status_code, error_of(answer)["where"]) == (422, [where])
    assert designing.calls == []


def test_what_the_design_refuses_is_told() -> None:
    refusing = AsyncPart(start=BadRequestError("limits are missing", ("request", "limits")))
    answer = client_of(designs.router, designing=refusing).post("/designs", json={"name": "d", "request": {}})
    assert (answer.status_code, error_of(answer)["where"]) == (422, ["request", "limits"])
