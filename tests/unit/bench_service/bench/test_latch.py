"""What is latched, what hides what, and what an acknowledgement clears."""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import pytest

from bench_service.bench import cycler_keeper
from bench_service.bench.control import BenchControl
from bench_service.bench.latch import INTERRUPTIONS, Latch
from bench_service.bench.limits import Limits
from bench_service.bench.links import FrameLink
from bench_service.bench.listener import BenchStatus
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Capabilities, Reading
from tests.patience import holds

LIMITS = Limits((2.0, 4.2), (-1.0, 1.0), (0.0, 45.0), (0.0, 1.0), None, 9.0)
CUT_OFF = Latch("interrupted", "run x was interrupted")
SETTINGS = BenchSettings("left", "modbus-tcp://h:1", "generic", LIMITS, latched=CUT_OFF, identity={"serial": "16"})
CAPABILITIES = Capabilities("device", "17", (-5, 5), (0, 5), (0.5, 5), True, True, True, True)
AT_REST = Reading(0.0, 0, 3.7, 0.0, 25.0, 25.0, 0.0, False, frozenset(), frozenset())


@pytest.mark.parametrize(
    ("state", "reason", "code"),
    [
        ("interrupted", "its control process has ended", "interrupted"),
        ("fault", "left: the recorder is gone; samples cannot be stored, output switched off", "recorder"),
        ("fault", "left: voltage 4.3 V is outside", "run_fault"),
    ],
)
def test_the_end_of_a_run_says_what_it_leaves(state: str, reason: str, code: str) -> None:
    assert Latch.of_run(state, reason) == Latch(code, reason)
    assert Latch.of_run("completed", None) is Latch.of_run("stopped", reason) is None


def test_what_takes_a_person_is_not_hidden_by_what_does_not() -> None:
    hot, other, ended = Latch("at_rest", "hot"), Latch("other_device", "another"), Latch("run_fault", "too warm")
    assert hot.over(None) == hot.over(CUT_OFF) == CUT_OFF.over(hot) == hot
    assert other.over(hot) == hot.over(other) == other
    assert ended.over(CUT_OFF) == CUT_OFF
    assert {hot.code, other.code, ended.code, "unknown"}.isdisjoint(INTERRUPTIONS)


def test_settings_carry_it() -> None:
    assert BenchSettings.from_json(SETTINGS.to_json()) == SETTINGS


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
        self.codes: list[str] = []
        self.link = FrameLink(sock, self._take, lambda _: None)

    def _take(self, header: dict[str, Any], _body: bytes) -> None:
        operation = header.pop("op")
        if operation == "state":
            self.status = BenchStatus(**header)
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
