"""Which requests of a browser are turned away before any route sees them."""

import socket
from typing import Any

import pytest
from fastapi import APIRouter, FastAPI, WebSocket

from bench_service.api.gate import Gate
from tests.unit.bench_service.api.route_rig import Client, error_of, websocket_talk

OWN = "127.0.0.1:8000"


def behind(host: str) -> Client:
    app, router = FastAPI(), APIRouter()

    @router.get("/thing")
    @router.post("/thing")
    @router.delete("/thing")
    def thing() -> dict[str, Any]:
        return {}

    @router.websocket("/live")
    async def live(connection: WebSocket) -> None:
        await connection.accept()
        await connection.close()

    app.include_router(router)
    app.add_middleware(Gate, host=host)
    return Client(app)


@pytest.fixture
def local() -> Client:
    return behind("127.0.0.1")


@pytest.mark.parametrize("host", [OWN, "127.0.0.1", "localhost:8000", "LOCALHOST", "[::1]:8000"])
def test_the_services_own_names_are_let_through(local: Client, host: str) -> None:
    assert local.get("/thing", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8000", "127.0.0.1.evil.example", "192.168.1.7", "", "[::"]
)
def test_a_name_that_was_rebound_is_refused_even_for_reading(local: Client, host: str) -> None:
    answer = local.get("/thing", headers={"host": host})
    assert (answer.status_code, error_of(answer)["code"]) == (403, "forbidden")


def test_two_hosts_are_refused(local: Client) -> None:
    answer = local.get("/thing", headers=[("host", OWN), ("host", "evil.example")])
    assert answer.status_code == 403


def test_the_name_that_it_is_bound_to_is_its_own() -> None:
    lab = behind("lab.example")
    assert lab.get("/thing", headers={"host": "Lab.Example:8000"}).status_code == 200
    assert lab.get("/thing", headers={"host": socket.gethostname() + ".elsewhere"}).status_code == 403
    assert behind("[fe80::1]").get("/thing", headers={"host": "[fe80::1]:8000"}).status_code == 200


@pytest.mark.parametrize("bound", ["0.0.0.0", "::"])
def test_bound_to_all_addresses_it_answers_to_numbers_and_to_the_machines_name(bound: str) -> None:
    everywhere = behind(bound)
    for host in ("192.168.1.7:8000", "[fe80::1]:8000", socket.gethostname(), OWN):
        assert everywhere.get("/thing", headers={"host": host}).status_code == 200
    # A name can be rebound, a number cannot.
    assert everywhere.get("/thing", headers={"host": "evil.example"}).status_code == 403


@pytest.mark.parametrize("method", ["POST", "DELETE"])
@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9999", "http://["])
def test_another_sites_script_changes_nothing(local: Client, method: str, origin: str) -> None:
    answer = local.request(method, "/thing", headers={"host": OWN, "origin": origin})
    assert answer.status_code == 403
    assert "another site" in error_of(answer)["message"]


def test_the_own_page_and_programs_without_an_origin_may_change(local: Client) -> None:
    assert local.post("/thing", headers={"host": OWN, "origin": f"http://{OWN}"}).status_code == 200
    assert local.post("/thing", headers={"host": OWN, "origin": f"HTTP://{OWN}"}).status_code == 200
    assert local.post("/thing", headers={"host": OWN}).status_code == 200


def test_reading_from_another_site_is_left_to_the_browser(local: Client) -> None:
    assert local.get("/thing", headers={"host": OWN, "origin": "http://evil.example"}).status_code == 200


def test_one_foreign_origin_among_several_is_enough(local: Client) -> None:
    headers = [("host", OWN), ("origin", f"http://{OWN}"), ("origin", "http://evil.example")]
    assert local.post("/thing", headers=headers).status_code == 403


@pytest.mark.parametrize(
    ("headers", "sent"),
    [
        ({"host": OWN, "origin": f"http://{OWN}"}, "websocket.accept"),
        ({"host": OWN}, "websocket.accept"),
        ({"host": OWN, "origin": "http://evil.example"}, "websocket.close"),
        ({"host": "evil.example"}, "websocket.close"),
    ],
)
async def test_a_websocket_of_another_site_is_not_opened(local: Client, headers: dict[str, str], sent: str) -> None:
    first = (await websocket_talk(local.app, "/live", headers))[0]
    assert first["type"] == sent
    assert first.get("code", 1008) == 1008


def test_a_long_host_is_cut_in_the_answer(local: Client) -> None:
    assert len(local.get("/thing", headers={"host": "x" * 4000}).text) < 400
