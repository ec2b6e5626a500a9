"""The control process in this very process: what it hears, and what it says."""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench_service.bench import control, cycler_keeper
from bench_service.bench.admission import RefusedError
from bench_service.bench.control import BenchControl
from bench_service.bench.direct.messages import Order
from bench_service.bench.latch import Latch
from bench_service.bench.limits import Limits
from bench_service.bench.links import FrameLink
from bench_service.bench.listener import BenchStatus
from bench_service.bench.request import RunRequest
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Capabilities, Reading
from tests.patience import holds

LIMITS = Limits((2.0, 4.2), (-1.0, 1.0), (0.0, 45.0), (0.0, 1.0), None, 9.0)
CUT_OFF = Latch("interrupted", "run x was interrupted")
SETTINGS = BenchSettings("left", "modbus-tcp://h:1", "generic", LIMITS, latched=CUT_OFF, identity={"serial": "16"})
CAPABILITIES = Capabilities("device", "17", (-5, 5), (0, 5), (0.5, 5), True, True, True, True)
AT_REST = Reading(0.0, 0, 3.7, 0.0, 25.0, 25.0, 0.0, False, frozenset(), frozenset())
REQUEST = RunRequest("r", 0.1, LIMITS, 3.0, np.array([0.0, 1.0]), np.array([0.5, 0.0]), initial_soc=0.5)


class Device:
    """A cycler that is at rest."""

    def __getattr__(self, name: str) -> Callable[[], Any]:
        async def call() -> Any:
            return {"connect": CAPABILITIES, "sample": AT_REST}.get(name)

        return call


class Heard:
    """This end of a control process's command link."""

    def __init__(self, sock: socket.socket) -> None:
        self.status = BenchStatus("offline")
        self.states: list[tuple[str, str | None]] = []
        self.codes: list[str] = []
        self.link = FrameLink(sock, self._take, lambda _: None)

    def _take(self, header: dict[str, Any], _body: bytes) -> None:
        operation = header.pop("op")
        if operation == "state":
            self.status = BenchStatus(**header)
            self.states.append((self.status.state, self.status.reason))
        elif operation == "event":
            self.codes.append(header["code"])


@asynccontextmanager
async def controlled(settings: BenchSettings) -> AsyncIterator[Heard]:
    """Have a bench controlled in this very process."""
    pairs = [socket.socketpair() for _ in range(2)]
    heard = Heard(pairs[0][0])
    serving = asyncio.create_task(BenchControl(settings, pairs[0][1], pairs[1][1]).serve())
    try:
        yield heard
    finally:
        heard.link.send({"op": "quit"})
        await serving
        heard.link.close()
        pairs[1][0].close()


async def test_who_acknowledges_one_fault_has_not_seen_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cycler_keeper, "open_cycler", lambda *_: Device())
    async with controlled(SETTINGS) as heard:
        await holds(lambda: heard.status.latch == "other_device", "another device than before is told")
        # Sent when the bench still said that a run was interrupted.
        heard.link.send({"op": "acknowledge", "reason": CUT_OFF.text})
        await holds(lambda: "fault_stays" in heard.codes, "it is not taken for the other device")
        assert heard.status.state == "fault" and "acknowledged" not in heard.codes
        heard.link.send({"op": "acknowledge", "reason": heard.status.reason})
        await holds(lambda: heard.status.state == "idle", "acknowledged")
        assert "acknowledged" in heard.codes and heard.status.latched is None


async def test_an_interruption_is_acknowledged_as_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cycler_keeper, "open_cycler", lambda *_: Device())
    async with controlled(replace(SETTINGS, identity=None)) as heard:
        await holds(lambda: "connected" in heard.codes, "connected")
        assert heard.status.latched == CUT_OFF
        heard.link.send({"op": "acknowledge", "reason": CUT_OFF.text})
        await holds(lambda: heard.status.state == "idle", "acknowledged")


async def test_a_stop_past_the_service_is_for_a_start_too_that_is_on_its_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stop port wakes the loop before the loop has looked whether something was sent."""
    taken: list[Callable[[Order], Any]] = []

    def direct(_sock: object, take: Callable[[Order], Any]) -> Any:
        taken.append(take)
        return SimpleNamespace(close=lambda: None)

    async def prepare(*_: object) -> None:
        raise RefusedError("not played in this test")

    monkeypatch.setattr(cycler_keeper, "open_cycler", lambda *_: Device())
    monkeypatch.setattr(control, "DirectOrders", direct)
    monkeypatch.setattr(control, "prepare", prepare)
    async with controlled(replace(SETTINGS, latched=None, identity=None)) as heard:
        await holds(lambda: heard.status.state == "idle", "idle")
        heard.link.send(*REQUEST.to_frame())
        taken[0](Order("stop", "stopped on the page"))
        await holds(lambda: "refused" in heard.codes, "the run has been taken up")
        assert ("stopping", "stopped on the page") in heard.states
        assert "running" not in {state for state, _ in heard.states}
        # One that the service has not sent yet is stopped there.
        assert heard.codes.index("stop_asked") < heard.codes.index("refused")
