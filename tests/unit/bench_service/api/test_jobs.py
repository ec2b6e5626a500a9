"""Jobs over REST."""

from bench_service.api import jobs
from bench_service.errors import NotFoundError
from bench_service.jobs.runner import Job
from tests.unit.bench_service.api.route_rig import Part, client_of


def test_a_job_is_given_with_its_result() -> None:
    part = Part(get=Job(id="j1", kind="fit", state="done", progress=1.0, result={"model_id": "m1"}))
    document = client_of(jobs.router, jobs=part).get("/jobs/j1").json()
    assert (document["state"], document["progress"], document["result"]) == ("done", 1.0, {"model_id": "m1"})


def test_one_that_is_cancelled_is_shown_as_it_is_then() -> None:
    part = Part(cancel=None, get=Job(id="j1", kind="fit", state="failed", error="cancelled"))
    document = client_of(jobs.router, jobs=part).post("/jobs/j1/cancel").json()
    assert (document["state"], document["error"]) == ("failed", "cancelled")
    assert [name for name, _, _ in part.calls] == ["cancel", "get"]


def test_an_unknown_job_is_404() -> None:
    part = Part(cancel=NotFoundError.of("job", "j9"), get=NotFoundError.of("job", "j9"))
    client = client_of(jobs.router, jobs=part)
    assert client.get("/jobs/j9").status_code == client.post("/jobs/j9/cancel").status_code == 404
