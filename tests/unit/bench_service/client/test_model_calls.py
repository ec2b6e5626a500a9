"""What the client asks for about models."""

import json
from typing import Any

import httpx
import pytest

from bench_service.client import BenchClient
from bench_service.client import connection as connections

URL = "http://127.0.0.1:1"


@pytest.fixture
def bodies(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    seen: list[dict[str, Any]] = []

    def answer(request: httpx.Request) -> httpx.Response:
        seen.append(json.loads(request.read()))
        return httpx.Response(201, json={"id": "k1", "result": {}})

    class Mocked(httpx.Client):
        def __init__(self, **options: Any) -> None:
            super().__init__(transport=httpx.MockTransport(answer), **options)

    monkeypatch.setattr(connections.httpx, "Client", Mocked)
    return seen


def test_a_comparison_names_baselines_only_where_they_are_asked_for(bodies: list[dict[str, Any]]) -> None:
    with BenchClient(URL) as client:
        client.compare("m1", ["r1"], 0.5)
        client.compare("m1", ["r1"], baselines=("1rc", "esc"))
        client.compare("m1", ["r1"], baselines=["2rc"], train_run_ids=("r2", "r3"))
    asked = {"model_id": "m1", "run_ids": ["r1"], "initial_soc": None}
    assert bodies == [
        asked | {"initial_soc": 0.5},
        asked | {"baselines": ["1rc", "esc"]},
        asked | {"baselines": ["2rc"], "train_run_ids": ["r2", "r3"]},
    ]
