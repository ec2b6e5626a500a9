"""A service beyond its own machine lets in who has its token, and nobody else."""

from typing import Any

import pytest
from fastapi import APIRouter, FastAPI, WebSocket

from bench_service.api.access import COOKIE
from bench_service.api.gate import Gate
from tests.unit.bench_service.api.route_rig import Client, error_of, websocket_talk

TOKEN = "a-token-of-some-length"
BEARER = {"authorization": f"Bearer {TOKEN}"}


@pytest.fixture
def guarded() -> Client:
    app, router = FastAPI(), APIRouter()

    @router.get("/")
    @router.get("/healthz")
    @router.get("/api/v1/benches")
    @router.post("/api/v1/benches/a/stop")
    def thing() -> dict[str, Any]:
        return {}

    @router.websocket("/live")
    async def live(connection: WebSocket) -> None:
        await connection.accept()
        await connection.close()

    app.include_router(router)
    app.add_middleware(Gate, host="0.0.0.0", token=TOKEN)  # noqa: S104
    return Client(app)


@pytest.mark.parametrize("address", ["/", "/healthz", "/api/v1/benches", "/api/v1/openapi.json", "/static/main.js"])
@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"authorization": "Bearer "},
        {"authorization": "Bearer wrong"},
        {"authorization": f"Basic {TOKEN}"},
        {"cookie": f"{COOKIE}={TOKEN}"},
        {"cookie": 'x="; ='},
    ],
)
def test_without_it_nothing_is_answered(guarded: Client, address: str, headers: dict[str, str]) -> None:
    answer = guarded.get(address, headers=headers)
    assert (answer.status_code, error_of(answer)["code"]) == (401, "unauthorized")
    assert "login link" in error_of(answer)["message"] and TOKEN not in answer.text


def test_a_program_sends_it_as_a_header(guarded: Client) -> None:
    assert guarded.get("/api/v1/benches", headers=BEARER).status_code == 200
    assert guarded.post("/api/v1/benches/a/stop", headers=BEARER).status_code == 200
    assert guarded.post("/api/v1/benches/a/stop").status_code == 401


def test_the_login_link_gives_the_page_a_cookie_that_no_script_sees_and_no_other_site_sends(guarded: Client) -> None:
    answer = guarded.get(f"/login?token={TOKEN}")
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie and TOKEN not in cookie
    assert guarded.get("/", headers={"cookie": cookie.partition(";")[0]}).status_code == 200
    for wrong in ("/login", "/login?token=wrong", "/login?token="):
        refused = guarded.get(wrong)
        assert refused.status_code == 401 and "set-cookie" not in refused.headers


def test_another_site_is_refused_whatever_it_carries(guarded: Client) -> None:
    answer = guarded.post("/api/v1/benches/a/stop", headers=BEARER | {"origin": "http://evil.example"})
    assert answer.status_code == 403


async def test_the_websocket_too(guarded: Client) -> None:
    host = {"host": "127.0.0.1:8000"}
    assert (await websocket_talk(guarded.app, "/live", host))[0]["type"] == "websocket.close"
    assert (await websocket_talk(guarded.app, "/live", host | BEARER))[0]["type"] == "websocket.accept"
