"""A service with one simulated bench, a client of it, and what tests of its REST interface share."""

import json
from dataclasses import dataclass
from typing import Any

import httpx
from service_rig import Service

from bench_service.client import BenchClient

SIMULATED = "[bench.sim]\nsimulate = { seed = 3 }\n"
RUN = {"bench": "sim", "dt_s": 0.1, "initial_soc": 0.5}


@dataclass(frozen=True)
class Rest:
    """The service, a client of it, and what the tests share."""

    service: Service
    client: BenchClient
    profile_id: str

    def post(self, address: str, body: object, **headers: str) -> httpx.Response:
        """Send a body as it stands; text is sent as raw JSON."""
        text = body if isinstance(body, str | bytes) else json.dumps(body)
        content_type = {"content-type": "application/json"}
        return httpx.post(f"{self.service.url}/api/v1{address}", content=text, headers=content_type | headers)

    def get(self, address: str, **headers: str) -> httpx.Response:
        return httpx.get(f"{self.service.url}{address}", headers=headers)


def error_of(answer: httpx.Response) -> dict[str, Any]:
    assert answer.headers["content-type"] == "application/json"
    error = answer.json()["error"]
    assert set(error) == {"code", "message", "where"}
    assert "\n" not in error["message"]
    return error
