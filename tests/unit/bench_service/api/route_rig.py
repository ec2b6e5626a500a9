"""Routes under test: an application of a few of them, over parts that answer what a test tells them to."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import httpx
from fastapi import APIRouter, FastAPI

from bench_service.api.errors import install_error_handlers
from bench_service.store.records import RunRecord, RunReference

MOMENT = "2026-01-02T03:04:05.000006Z"
REFERENCE = RunReference("r1", "abc")


class Part:
    """A part of the service whose methods give the answers named here; an exception is raised.

    Attributes
    ----------
    calls : list of (name, positional arguments, named arguments)
        In their order.
    """

    def __init__(self, **answers: Any) -> None:
        self.calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
        self._answers = answers

    def __getattr__(self, name: str) -> Any:
        if name not in self._answers:
            raise AttributeError(name)

        def method(*arguments: Any, **named: Any) -> Any:
            self.calls.append((name, arguments, named))
            answer = self._answers[name]
            if isinstance(answer, Exception):
                raise answer
            return answer

        return method


class AsyncPart(Part):
    """The same with methods that are awaited."""

    def __getattr__(self, name: str) -> Any:
        method = super().__getattr__(name)

        async def awaited(*arguments: Any, **named: Any) -> Any:
            return method(*arguments, **named)

        return awaited


class Table(Part):
    """A table of a store; its calls bear its name, ``runs.get``, and are noted with those of the other tables."""

    def __init__(self, name: str, calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]], answers: Any) -> None:
        super().__init__(**{f"{name}.{method}": answer for method, answer in answers.items()})
        self.calls = calls
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return super().__getattr__(f"{self._name}.{name}")


class Store:
    """A store of the tables named here, each with the answers of its methods: ``Store(runs={"get": record})``.

    Attributes
    ----------
    calls : list of (table and method, positional arguments, named arguments)
        Of all tables, in their order.
    """

    def __init__(self, **tables: dict[str, Any]) -> None:
        self.calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
        self._tables = {name: Table(name, self.calls, answers) for name, answers in tables.items()}

    def __getattr__(self, name: str) -> Table:
        if name not in self._tables:
            raise AttributeError(name)
        return self._tables[name]


class Client:
    """Sends requests to an application in this very process; each has an event loop of its own."""

    def __init__(self, app: Any) -> None:
        self.app = app

    def request(self, method: str, address: str, **options: Any) -> httpx.Response:
        """Send one request; an error inside the application is answered, not raised."""

        async def sent() -> httpx.Response:
            transport = httpx.ASGITransport(self.app, raise_app_exceptions=False)
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000") as client:
                return await client.request(method, address, **options)

        return asyncio.run(sent())

    def get(self, address: str, **options: Any) -> httpx.Response:
        """Send a GET."""
        return self.request("GET", address, **options)

    def post(self, address: str, **options: Any) -> httpx.Response:
        """Send a POST."""
        return self.request("POST", address, **options)


async def websocket_talk(app: Any, address: str, headers: dict[str, str], *received: dict[str, Any]) -> list[Any]:
    """Open a WebSocket, hand the application some messages, and give everything that it sent."""
    waiting, sent = [{"type": "websocket.connect"}, *received], []
    names = [(name.lower().encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": "websocket", "path": address, "headers": names, "query_string": b"", "scheme": "ws"}

    async def receive() -> dict[str, Any]:
        # What stands before the client's next message is sent first.
        await asyncio.sleep(0)
        return waiting.pop(0) if waiting else await asyncio.Event().wait()  # pyright: ignore[reportReturnType]

    async def send(message: Any) -> None:
        sent.append(message)

    await app(scope, receive, send)
    return sent


def client_of(*routers: APIRouter, **parts: Any) -> Client:
    """Serve routes, without a socket, over some parts."""
    app = FastAPI()
    app.state.services = SimpleNamespace(**parts)
    install_error_handlers(app)
    for router in routers:
        app.include_router(router)
    return Client(app)


def error_of(answer: httpx.Response) -> dict[str, Any]:
    """Give what an error answer says; it says nothing else."""
    document = answer.json()
    assert list(document) == ["error"] and list(document["error"]) == ["code", "message", "where"]
    return document["error"]


def run_record(**changes: Any) -> RunRecord:
    """A run that was completed."""
    fields: dict[str, Any] = {
        "id": "r1",
        "number": 1,
        "bench": "sim",
        "profile_id": "p1",
        "state": "completed",
        "dt_s": 1.0,
        "created_utc": MOMENT,
        "started_utc": MOMENT,
        "initial_soc": 0.5,
        "capacity_Ah": 2.0,
        "limits": {},
        "code_version": "1",
    }
    return RunRecord(**(fields | changes))
