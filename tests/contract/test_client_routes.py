"""The client has a method for every address that the service serves, and asks for none that it does not."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from bench_service.app.application import create_app
from bench_service.client import BenchClient
from bench_service.client import connection as connections
from bench_service.config import ServiceConfig

# What a job, run or campaign is told to have become, so that waiting for it ends, and whatever else an answer may have.
ANSWER = {
    "id": "x1",
    "state": "completed",
    "result": {"diagnosis_id": "x1", "model_id": "x1"},
    "n_bytes": 0,
    "bench": "b",
    "url": "http://127.0.0.1:1",
    "token": "t",
    "next_cursor": None,
    "comparison_id": "x1",
    "run_ids": ["x1"],
}
LISTS = ("benches", "cells", "profiles", "runs", "events", "models", "comparisons", "diagnoses", "effects", "campaigns",
         "mappings", "protocols", "standard_tests", "formats", "steps", "cycles")  # fmt: skip
# Calls that take more than words: what is said in their place.
SAID: dict[str, dict[str, Any]] = {
    "upload_profile": {"time_s": [0.0, 1.0], "current_A": [0.0, 0.0]},
    "start_run": {"dt_s": 1.0, "initial_soc": 0.5},
    "samples": {"stream": "samples"},
    "every": {"kind": "runs"},
    "fit": {"train": ["r"], "capacity_Ah": 2.5},
    "import_model": {"document": {}},
    "design": {"request": {}},
    "start_campaign": {"request": {}},
    "estimate_campaign": {"request": {}},
    "store_import": {"capacity_Ah": 2.5, "initial_soc": 0.5},
    "save_mapping": {"mapping": {}},
    "trend": {"run_ids": ["r"]},
    "upload_protocol": {"document": {}},
    "add_standard_test": {"parameters": {}},
}


def served(folder: Path) -> list[tuple[str, re.Pattern[str], str]]:
    paths = create_app(ServiceConfig(data_dir=folder)).openapi()["paths"]
    return [
        (method.upper(), re.compile(re.sub(r"\{\w+\}", r"[^/]+", address) + r"\Z"), f"{method.upper()} {address}")
        for address, methods in paths.items()
        for method in methods
    ]


def calls(client: BenchClient) -> Iterator[tuple[str, Callable[..., Any]]]:
    for name, value in inspect.getmembers(client, callable):
        if not name.startswith("_") and name not in ("close",):
            yield name, value


def arguments(name: str, call: Callable[..., Any], file: Path) -> dict[str, Any]:
    said = SAID.get(name, {})
    given = dict(said)
    for each in inspect.signature(call).parameters.values():
        if each.name in given or each.kind in (each.VAR_KEYWORD, each.VAR_POSITIONAL) or each.default is not each.empty:
            continue
        words = each.name.endswith(("run_ids", "_ids")) or each.name == "runs"
        given[each.name] = file if each.name == "path" else ["x1"] if words else "x1"
    return given


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    seen: list[tuple[str, str]] = []

    def answer(request: httpx.Request) -> httpx.Response:
        request.read()
        seen.append((request.method, request.url.path))
        state = "done" if "/jobs/" in request.url.path or request.url.path.endswith("/jobs") else "completed"
        told = ANSWER | {name: [] for name in LISTS} | {"state": state}
        return httpx.Response(200, json=told, headers={"content-disposition": 'attachment; filename="x"'})

    class Mocked(httpx.Client):
        def __init__(self, **options: Any) -> None:
            super().__init__(transport=httpx.MockTransport(answer), **options)

    monkeypatch.setattr(connections.httpx, "Client", Mocked)
    return seen


def titles(known: list[tuple[str, re.Pattern[str], str]], method: str, path: str) -> str:
    """The address that a request went to; of several that fit the one with most fixed parts."""
    fits = [title for served_method, pattern, title in known if served_method == method and pattern.match(path)]
    assert fits, f"{method} {path} is not served"
    return min(fits, key=lambda title: title.count("{"))


def test_every_address_has_a_call_and_every_call_an_address(tmp_path: Path, asked: list[tuple[str, str]]) -> None:
    known = served(tmp_path)
    file = tmp_path / "file.csv"
    file.write_text("time_s\n0\n")
    with BenchClient("http://127.0.0.1:1") as client:
        for name, call in calls(client):
            before = len(asked)
            found = call(**arguments(name, call, file))
            if inspect.isgenerator(found):
                list(found)
            assert len(asked) > before, f"{name} asks for nothing"
        # What these ask for besides, where they are told more.
        client.samples("x1", stream="observer")
        client.events("x1")
    reached = {titles(known, *each) for each in asked}
    assert {title for _, _, title in known} - reached == set()
