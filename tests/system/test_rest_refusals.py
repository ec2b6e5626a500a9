"""What the REST interface refuses, and how it says so."""

import json
import socket
from pathlib import Path
from typing import Any

import httpx
import pytest
from rest_rig import RUN, Rest, error_of


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", '"0.5"', "true", "null", "[0.5]", "{}"])
@pytest.mark.parametrize("field", ["dt_s", "initial_soc"])
def test_what_is_no_number_is_refused(rest: Rest, field: str, number: str) -> None:
    body = json.dumps(RUN | {"profile_id": rest.profile_id, field: "HERE"}).replace('"HERE"', number)
    answer = rest.post("/runs", body)
    assert answer.status_code == 422
    assert error_of(answer)["code"] in ("bad_request", "bad_json")


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999", '"1"', "true", "null"])
def test_what_is_no_number_in_a_profile_is_refused(rest: Rest, number: str) -> None:
    answer = rest.post("/profiles", f'{{"name":"x","time_s":[0,1],"current_A":[{number},0]}}')
    assert answer.status_code == 422 and error_of(answer)


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"colour": "red"}, ["colour"]),
        ({"limits": {"voltage_v": [3, 4]}}, ["limits", "voltage_v"]),
        ({"limits": {"voltage_V": [3.0, 4.3]}}, ["limits"]),
        ({"limits": {"current_A": [-1.0, 1.0]}}, ["profile", "current_A", 1]),
        ({"limits": {"duration_s": 59.0}}, ["profile", "time_s"]),
        ({"limits": {"ramp_A_per_s": 1.0}}, ["profile", "current_A", 1]),
        ({"limits": {"soc": [0.495, 0.6]}}, ["profile", "time_s", 3]),
        ({"initial_soc": 1.5}, ["initial_soc"]),
        ({"dt_s": 0}, ["dt_s"]),
        ({"name": "two\nlines"}, ["name"]),
        ({"seed": 1.5}, ["seed"]),
    ],
)
def test_a_run_that_is_not_admitted_says_why(rest: Rest, changes: dict[str, Any], where: list[Any]) -> None:
    if "soc" in changes.get("limits", {}):
        changes = changes | {"profile_id": rest.client.upload_profile("down", [0, 1, 2, 60], [0, 0, -2, 0])["id"]}
        changes["limits"] = {"soc": [0.49, 0.6]}
        changes["initial_soc"] = 0.5
        where = ["profile", "time_s", 3]
    answer = rest.post("/runs", RUN | {"profile_id": rest.profile_id} | changes)
    assert answer.status_code == 422
    assert error_of(answer)["where"] == where


@pytest.mark.parametrize(
    "body",
    [
        "",
        "{",
        "[]",
        '{"\\ud800":1}',
        "null",
        '{"bench":"sim","bench":"sim"}',
        "[" * 100_000,
        b"\xff\xfe",
        '{"dt_s":' + "9" * 5000 + "}",
    ],
)
def test_a_body_that_is_no_object_is_refused(rest: Rest, body: str | bytes) -> None:
    answer = rest.post("/runs", body)
    assert answer.status_code == 422 and error_of(answer)


@pytest.mark.parametrize("content_type", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""])
def test_other_content_types_are_refused(rest: Rest, content_type: str) -> None:
    for address in ("/runs", "/profiles", "/models"):
        answer = rest.post(address, "{}", **{"content-type": content_type})
        assert answer.status_code == 415 and error_of(answer)["code"] == "wrong_content_type"


def peak_MB(rest: Rest) -> float:
    status = Path(f"/proc/{rest.service.process.pid}/status").read_text()
    return next(int(line.split()[1]) / 1000 for line in status.splitlines() if line.startswith("VmHWM"))


def test_a_body_that_is_too_large_is_refused(rest: Rest) -> None:
    answer = rest.post("/runs", b" " * 1_000_001)
    assert answer.status_code == 413 and error_of(answer)["code"] == "too_large"
    assert rest.post("/profiles", b" " * 1_000_001).status_code == 422


def test_a_flood_without_an_end_is_refused_while_it_comes(rest: Rest) -> None:
    before_MB = peak_MB(rest)
    host, port = rest.service.url.removeprefix("http://").split(":")
    part = b"f4240\r\n" + b" " * 1_000_000 + b"\r\n"
    sent = 0
    with socket.create_connection((host, int(port)), 20) as link:
        head = f"POST /api/v1/profiles HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\n"
        link.sendall(f"{head}Transfer-Encoding: chunked\r\n\r\n".encode())
        with pytest.raises(ConnectionError):
            for _ in range(300):
                link.sendall(part)
                sent += 1
    assert 20 <= sent < 100
    assert peak_MB(rest) < before_MB + 60
    assert rest.client.health()["status"] == "ok"


@pytest.mark.parametrize(
    "address",
    [
        "/api/v1/none",
        "/none",
        "/api/v1/benches/none",
        "/api/v1/profiles/none",
        "/api/v1/runs/none",
        "/api/v1/runs/none/samples",
        "/api/v1/runs/none/export",
        "/api/v1/runs/none/events",
        "/api/v1/models/none",
        "/api/v1/models/none/document",
        "/api/v1/models/none/tables",
        "/api/v1/jobs/none",
        "/api/v1/comparisons/none",
        "/api/v1/runs/..%2f..%2f..%2fetc%2fpasswd",
        "/api/v1/runs/%00",
        "/static/..%2f..%2fconfig.py",
        "/static/%2e%2e/%2e%2e/config.py",
    ],
)
def test_what_is_not_there_is_404(rest: Rest, address: str) -> None:
    answer = rest.get(address)
    assert answer.status_code == 404 and error_of(answer)["code"] == "not_found"


def test_unknown_things_in_a_run_are_404(rest: Rest) -> None:
    assert rest.post("/runs", RUN | {"profile_id": rest.profile_id, "bench": "none"}).status_code == 404
    assert rest.post("/runs", RUN | {"profile_id": "none"}).status_code == 404
    assert rest.post("/runs", RUN | {"profile_id": rest.profile_id, "model_id": "none"}).status_code == 404
    assert rest.post("/runs/none/stop", "").status_code == 404


def test_wrong_methods_and_queries(rest: Rest) -> None:
    rest.service.idle("sim")
    played = rest.client.start_run("sim", rest.profile_id, 0.1, 0.5)
    assert error_of(httpx.delete(f"{rest.service.url}/api/v1/runs"))["code"] == "method_not_allowed"
    for query in ("from_s=nan", "to_s=1e999", "max_points=0", "max_points=x", "from_s=2&to_s=1"):
        assert rest.get(f"/api/v1/runs/{played['id']}/samples?{query}").status_code == 422
    assert rest.get("/api/v1/runs?limit=0").status_code == 422
    assert rest.get("/api/v1/runs?offset=99999999999999999999").status_code == 422


def test_other_hosts_and_origins_are_turned_away(rest: Rest) -> None:
    host = rest.service.url.removeprefix("http://")
    port = host.split(":")[1]
    for own in (host, f"localhost:{port}", f"[::1]:{port}"):
        assert rest.get("/healthz", host=own).status_code == 200
    for foreign in ("evil.example", f"evil.example:{port}", "127.0.0.1.evil.example", f"192.168.1.1:{port}"):
        answer = rest.get("/healthz", host=foreign)
        assert answer.status_code == 403 and error_of(answer)["code"] == "forbidden"
    stop = "/benches/sim/stop"
    for origin in ("http://evil.example", "null", f"http://localhost:{int(port) + 1}", "http://["):
        assert rest.post(stop, "", origin=origin).status_code == 403
    assert rest.post(stop, "", origin=rest.service.url).status_code == 200
