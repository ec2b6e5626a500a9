"""The client for several things at a time: the calls of the other one, awaited."""

import asyncio
import inspect
import threading
import time
from typing import Any

import httpx
import pytest

from bench_service.client import AsyncBenchClient, BenchClient, ClientError
from bench_service.client import connection as connections
from tests.patience import PATIENCE_S

URL = "http://127.0.0.1:1"


class Service:
    """Answers as a service does: run `a` ends at the third look, `b` never, all else is not known."""

    def __init__(self) -> None:
        self.looks: dict[str, int] = {}
        self.both = threading.Barrier(2)
        self.lock = threading.Lock()

    def answer(self, request: httpx.Request) -> httpx.Response:
        name = request.url.path.rpartition("/")[2]
        with self.lock:
            self.looks[name] = self.looks.get(name, 0) + 1
        if name == "meet":
            self.both.wait(PATIENCE_S)
            return httpx.Response(200, json={"id": name})
        if name == "cells":
            return httpx.Response(200, json={"cells": [{"id": "c"}], "next_cursor": None})
        if name not in ("a", "b"):
            error = {"message": f"run {name} is not known", "code": "not_found", "where": []}
            return httpx.Response(404, json={"error": error})
        ended = name == "a" and self.looks[name] > 2
        return httpx.Response(200, json={"id": name, "state": "completed" if ended else "running"})


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> Service:
    found = Service()

    class Mocked(httpx.Client):
        def __init__(self, **options: Any) -> None:
            super().__init__(transport=httpx.MockTransport(found.answer), **options)

    monkeypatch.setattr(connections.httpx, "Client", Mocked)
    return found


def calls(client: object) -> set[str]:
    return {name for name, _ in inspect.getmembers(client, callable) if not name.startswith("_")}


async def test_it_has_the_calls_of_the_other_one_with_their_signatures(service: Service) -> None:
    with BenchClient(URL) as plain:
        async with AsyncBenchClient(URL) as client:
            assert calls(client) == calls(plain)
            assert client.url == plain.url
            for name in calls(plain) - {"close"}:
                assert inspect.iscoroutinefunction(getattr(client, name)), name
                assert getattr(client, name).__doc__ == getattr(plain, name).__doc__ or name in ("cells", "every")


async def test_answers_refusals_and_pages_are_those_of_the_other_one(service: Service) -> None:
    async with AsyncBenchClient(URL) as client:
        assert (await client.wait_run("a", poll_s=0.0))["state"] == "completed"
        assert await client.cells() == await client.every("cells") == [{"id": "c"}]
        with pytest.raises(ClientError, match="run x is not known"):
            await client.run("x")


async def test_requests_are_under_way_at_the_same_time(service: Service) -> None:
    async with AsyncBenchClient(URL) as client:
        # Each is answered only once both have been asked.
        answers = await asyncio.wait_for(asyncio.gather(client.run("meet"), client.run("meet")), PATIENCE_S)
    assert [each["id"] for each in answers] == ["meet", "meet"]


async def test_a_wait_that_is_cancelled_ends_and_leaves_the_run_alone(service: Service) -> None:
    client = AsyncBenchClient(URL)
    waiting = asyncio.create_task(client.wait_run("b", poll_s=PATIENCE_S))
    while not service.looks.get("b"):
        await asyncio.sleep(0.01)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    began_s = time.monotonic()
    await client.close()  # waits for the threads
    assert time.monotonic() - began_s < PATIENCE_S / 2
    assert service.looks == {"b": 1}
