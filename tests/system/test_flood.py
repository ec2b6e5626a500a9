"""The service under requests that are too many, too long, or never whole: it answers, and stop answers at once."""

import contextlib
import socket
import statistics
import threading
import time
from collections.abc import Iterator

import httpx
import pytest
from rest_rig import Rest

from bench_service.app.http_protocol import MOST_CONNECTIONS
from tests.patience import PATIENCE_S, stretched


def address(rest: Rest) -> tuple[str, int]:
    host, _, port = rest.service.url.removeprefix("http://").partition(":")
    return host, int(port)


@contextlib.contextmanager
def half_sent(rest: Rest, count: int) -> Iterator[list[socket.socket]]:
    socks = []
    try:
        for _ in range(count):
            socks.append(socket.create_connection(address(rest), PATIENCE_S))
            socks[-1].sendall(b"POST /api/v1/profiles HTTP/1.1\r\nHost: ")
        yield socks
    finally:
        for sock in socks:
            sock.close()


def stop_s(rest: Rest) -> float:
    began_s = time.monotonic()
    assert httpx.post(f"{rest.service.url}/api/v1/benches/sim/stop", timeout=PATIENCE_S).status_code == 200
    return time.monotonic() - began_s


def test_half_sent_requests_lose_their_place_to_the_next(rest: Rest) -> None:
    with half_sent(rest, MOST_CONNECTIONS + 100) as socks:
        assert stop_s(rest) < stretched(0.5)
        socks[0].settimeout(PATIENCE_S)
        with contextlib.suppress(ConnectionResetError):
            assert socks[0].recv(10) == b""  # the oldest had to go
    assert rest.client.health()["status"] == "ok"


@pytest.mark.parametrize(
    "junk",
    [
        b"[" + b"0.5," * 2_000_000 + b"1]",
        pytest.param(b'{"a": ' + b'{"k": [1, 2]},' * 500_000, marks=pytest.mark.proof),
    ],
)
def test_stop_does_not_wait_for_long_bodies(rest: Rest, junk: bytes) -> None:
    done, statuses = threading.Event(), list[int]()

    def flood() -> None:
        with httpx.Client(timeout=PATIENCE_S) as client:
            while not done.is_set():
                headers = {"content-type": "application/json"}
                answer = client.post(f"{rest.service.url}/api/v1/models/import", content=junk, headers=headers)
                statuses.append(answer.status_code)

    sender = threading.Thread(target=flood)
    sender.start()
    try:
        while not statuses:
            time.sleep(0.01)
        took_s = [stop_s(rest) for _ in range(10)]
    finally:
        done.set()
        sender.join()
    assert set(statuses) == {422}
    assert statistics.median(took_s) < stretched(0.1)
