import asyncio
from collections.abc import Iterator
from typing import Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from bench_service.app import http_protocol
from bench_service.app.http_protocol import PatientProtocol


class Transport(asyncio.Transport):
    def __init__(self) -> None:
        super().__init__()
        self.aborted = False
        self.written = b""

    def abort(self) -> None:
        self.aborted = True

    def write(self, data: Any) -> None:
        self.written += data

    def is_closing(self) -> bool:
        return self.aborted

    def close(self) -> None:
        self.aborted = True

    def pause_reading(self) -> None: ...

    def resume_reading(self) -> None: ...


async def application(scope: Any, receive: Any, send: Any) -> None:
    while (await receive())["more_body"]:
        pass
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"0")]})
    await send({"type": "http.response.body"})


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(http_protocol, "HEAD_S", 0.05)
    monkeypatch.setattr(http_protocol, "BODY_S", 0.1)
    yield


def connected(state: ServerState) -> tuple[PatientProtocol, Transport]:
    config = uvicorn.Config(application, lifespan="off", log_config=None)
    protocol, transport = PatientProtocol(config=config, server_state=state, app_state={}), Transport()
    protocol.connection_made(transport)
    return protocol, transport


@pytest.mark.parametrize("sent", [b"", b"GET / HT", b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\nabc"])
async def test_a_request_that_does_not_come_is_not_waited_for(quick: None, sent: bytes) -> None:
    protocol, transport = connected(ServerState())
    if sent:
        protocol.data_received(sent)
    await asyncio.sleep(0.01)
    assert not transport.aborted
    await asyncio.sleep(0.3)
    assert transport.aborted
    protocol.connection_lost(None)


async def test_a_whole_request_is_answered_and_the_connection_kept(quick: None) -> None:
    protocol, transport = connected(ServerState())
    for _ in range(2):
        protocol.data_received(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 3\r\n\r\n")
        protocol.data_received(b"abc")
        await asyncio.sleep(0.02)
    assert transport.written.count(b"200 OK") == 2 and not transport.aborted
    protocol.connection_lost(None)


async def test_the_oldest_that_waits_makes_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_protocol, "MOST_CONNECTIONS", 2)
    state = ServerState()
    pairs = [connected(state) for _ in range(3)]
    assert [transport.aborted for _, transport in pairs] == [True, False, False]
    for protocol, _ in pairs:
        protocol.connection_lost(None)
