"""Trends over REST."""

from typing import Any

import pytest

from bench_service.api import trends
from bench_service.campaign.trending import TrendOrder
from bench_service.errors import ConflictError
from bench_service.jobs.runner import Job
from tests.unit.bench_service.api.route_rig import AsyncPart, Part, client_of, error_of

JOB = Job(id="j1", kind="trend")
BODY = {"model_id": "m1", "run_ids": ["r1", "r2"]}


def test_runs_are_counted_where_nobody_says_where_they_are() -> None:
    trending = AsyncPart(start_trend=JOB)
    answer = client_of(trends.router, trending=trending).post("/trends", json=BODY)
    assert (answer.status_code, answer.json()["id"]) == (202, "j1")
    assert trending.calls == [("start_trend", (TrendOrder(model_id="m1", run_ids=["r1", "r2"]),), {})]


@pytest.mark.parametrize(
    "changes",
    [{"run_ids": []}, {"initial_soc": [0.5, 1.2]}, {"at": ["x"]}, {"unit": ""}, {"end": 1.0}, {"end": 0.0}, {"x": 1}],
)
def test_what_is_none_is_refused(changes: dict[str, Any]) -> None:
    trending = AsyncPart(start_trend=JOB)
    answer = client_of(trends.router, trending=trending).post("/trends", json=BODY | changes)
    assert answer.status_code == 422 and error_of(answer)["where"][0] in changes
    assert trending.calls == []


def test_the_answer_is_given_as_a_table() -> None:
    client = client_of(trends.router, trending=Part(table="run,at\nr1,1\n"))
    answer = client.get("/trends/j1/table")
    assert answer.text == "run,at\nr1,1\n"
    assert answer.headers["content-type"].startswith("text/csv") and "life-j1.csv" in str(answer.headers)
    early = client_of(trends.router, trending=Part(table=ConflictError("job j1 is queued", ("job",))))
    assert early.get("/trends/j1/table").status_code == 409
