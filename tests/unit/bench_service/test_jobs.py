"""Jobs run in real worker processes."""

import asyncio
import os
import signal
import threading
import time
from collections.abc import AsyncIterator

import pytest

from bench_service.errors import NotFoundError
from bench_service.jobs.progress import Reporter
from bench_service.jobs.runner import Job, JobRunner
from tests.patience import PATIENCE_S, holds

# Lower than what the tests run at, and yet not starved where others keep the machine busy (19 gets 1.5 % there).
_NICE = 3


def add(report: Reporter, a: float, b: float) -> dict:
    report(0.5, "adding")
    return {"sum": a + b, "nice": os.nice(0), "pid": os.getpid()}


def refuse(report: Reporter) -> dict:
    raise ValueError("the runs hold 3 samples, at least 100 are needed")


def die(report: Reporter) -> dict:
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


def last_long(report: Reporter) -> dict:
    time.sleep(4 * PATIENCE_S)
    return {}


@pytest.fixture
async def changes() -> list[Job]:
    return []


@pytest.fixture
async def runner(changes: list[Job]) -> AsyncIterator[JobRunner]:
    runner = JobRunner(1, changes.append, nice=_NICE)
    await runner.start()
    yield runner
    await runner.stop()


async def test_result_is_stored_before_the_job_is_done(runner: JobRunner, changes: list[Job]) -> None:
    stored: list[dict] = []
    job = await runner.wait(
        runner.submit("fit", add, 1.0, 2.0, store=lambda result: stored.append(result) or {"id": "m"}).id
    )
    assert job.state == "done" and job.progress == 1.0 and job.result == {"id": "m"}
    assert (
        stored[0]["sum"] == 3.0 and stored[0]["nice"] == min(os.nice(0) + _NICE, 19) and stored[0]["pid"] != os.getpid()
    )
    assert [change.state for change in changes][0] == "queued" and "adding" in {c.message for c in changes}


async def test_a_job_that_refuses_tells_why(runner: JobRunner) -> None:
    job = await runner.wait(runner.submit("fit", refuse).id)
    assert (job.state, job.error) == ("failed", "the runs hold 3 samples, at least 100 are needed")


async def test_a_dead_worker_fails_its_job_and_the_next_one_runs(runner: JobRunner) -> None:
    dead = runner.submit("fit", die)
    alive = runner.submit("fit", add, 2.0, 2.0)
    assert (await runner.wait(dead.id)).state == "failed"
    assert "worker process died" in (runner.get(dead.id).error or "")
    assert (await runner.wait(alive.id)).state == "done"


async def test_what_a_person_waits_for_does_not_stand_behind_a_long_job(runner: JobRunner) -> None:
    running, queued = runner.submit("fit", last_long), runner.submit("fit", last_long)
    assert (await runner.wait(runner.submit("comparison", add, 1.0, 2.0).id)).state == "done"
    assert not running.ended and not runner.get(running.id).ended and runner.get(queued.id).state == "queued"


async def test_cancelling_ends_a_running_and_a_queued_job(runner: JobRunner, changes: list[Job]) -> None:
    running, queued = runner.submit("fit", last_long), runner.submit("fit", last_long)
    await holds(
        lambda: any(c.id == running.id and c.state == "running" and c.progress == 0 for c in changes[3:]), "it runs"
    )
    runner.cancel(queued.id)
    runner.cancel(running.id)
    async with asyncio.timeout(PATIENCE_S):
        jobs = [await runner.wait(job.id) for job in (running, queued)]
    assert [(job.state, job.error) for job in jobs] == [("failed", "cancelled")] * 2


async def test_what_is_being_stored_is_stored_to_its_end(runner: JobRunner, changes: list[Job]) -> None:
    """A cancellation then does nothing: the worker has gone on, to nothing or to another job."""
    storing, go_on = threading.Event(), threading.Event()

    def store(result: dict) -> dict:
        storing.set()
        go_on.wait(PATIENCE_S)
        return result

    job = runner.submit("fit", add, 1.0, 2.0, store=store)
    await holds(storing.is_set, "it is being stored")
    runner.cancel(job.id)
    go_on.set()
    stored = await runner.wait(job.id)
    assert (stored.state, stored.error) == ("done", None) and stored.result is not None
    assert "failed" not in {change.state for change in changes}
    following = await runner.wait(runner.submit("fit", add, 2.0, 2.0).id)
    assert following.state == "done" and following.result is not None
    assert following.result["pid"] == stored.result["pid"]


async def test_unknown_job(runner: JobRunner) -> None:
    with pytest.raises(NotFoundError, match="unknown job 'x'"):
        runner.get("x")
