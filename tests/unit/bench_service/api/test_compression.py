"""Answers are packed for whoever takes it, and only where it is worth it."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi import FastAPI, Response
from fastapi.responses import StreamingResponse

from bench_service.api.compression import Compression
from tests.unit.bench_service.api.route_rig import Client

LONG = {"numbers": list(range(2000))}


def app() -> FastAPI:
    found = FastAPI()

    @found.get("/long")
    def long() -> dict[str, Any]:
        return LONG

    @found.get("/short")
    def short() -> dict[str, Any]:
        return {"n": 1}

    @found.get("/file")
    def file() -> Response:
        return Response(b"x" * 5000, media_type="application/octet-stream")

    @found.get("/parts")
    def parts() -> Response:
        return StreamingResponse(iter([b"[" + b"1," * 2000, b"1]"]), media_type="application/json")

    found.add_middleware(Compression)
    return found


def test_a_long_json_answer_is_packed_and_says_so() -> None:
    answer = Client(app()).get("/long")
    assert answer.json() == LONG and answer.headers["content-encoding"] == "gzip"
    assert int(answer.headers["content-length"]) < len(str(LONG)) and "Accept-Encoding" in answer.headers["vary"]


@pytest.mark.parametrize("address", ["short", "file", "parts"])
def test_what_is_short_no_json_or_comes_in_parts_passes_as_it_is(address: str) -> None:
    answer = Client(app()).get(f"/{address}")
    assert answer.status_code == 200 and "content-encoding" not in answer.headers and answer.content


def test_who_does_not_read_gzip_gets_it_plain() -> None:
    answer = Client(app()).get("/long", headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in answer.headers and answer.json() == LONG
