"""`commission` asks before current flows, and its exit status says whether the bench is commissioned."""

import io
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from bench_service.cli import service
from bench_service.cli.main import main

CHECK = {"name": "sign", "outcome": "passed", "text": "dV/dI 0.03 Ohm", "values": {}}
PROBED = {"bench": "left", "state": "probed", "reason": None, "identity": {}, "checks": [CHECK], "record": None}


class Service:
    def __init__(self, probed: str = "probed", proved: str = "passed") -> None:
        self.states = {False: probed, True: proved}
        self.orders: list[dict[str, Any]] = []

    def commission(self, bench: str, *, confirm: bool = False, **order: Any) -> dict[str, Any]:
        self.orders.append(order | {"confirm": confirm})
        record = {"record": "r1", "sha256": "abc"} if confirm else {"record": None, "sha256": None}
        return PROBED | {"bench": bench, "state": self.states[confirm]} | record


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Iterator[Service]:
    fake = Service()

    @contextmanager
    def connected(*_: Any) -> Iterator[Service]:
        yield fake

    monkeypatch.setattr(service, "connected", connected)
    yield fake


def test_yes_goes_on_after_the_probe(asked: Service, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["commission", "left", "--yes", "--current", "0.5", "--json"]) == 0
    assert [order["confirm"] for order in asked.orders] == [False, True]
    assert asked.orders[1]["current_A"] == 0.5
    answer = json.loads(capsys.readouterr().out)
    assert (answer["state"], answer["record"], answer["sha256"]) == ("commissioned", "r1", "abc")


def test_without_it_a_program_gets_the_probe_alone(asked: Service, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["commission", "left"]) == 1
    said = capsys.readouterr()
    assert "left: probed" in said.out and "nothing is proved" in said.err
    assert [order["confirm"] for order in asked.orders] == [False]


@pytest.mark.parametrize(("typed", "confirmed"), [("y\n", True), ("\n", False), ("no\n", False)])
def test_a_person_is_asked(
    asked: Service, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], typed: str, confirmed: bool
) -> None:
    typing = io.StringIO(typed)
    monkeypatch.setattr(typing, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stdin", typing)
    assert main(["commission", "left", "--resistor", "1.5"]) == int(not confirmed)
    assert len(asked.orders) == 1 + confirmed
    assert "Now current flows" in capsys.readouterr().err


@pytest.mark.parametrize("states", [("failed", "passed"), ("probed", "failed"), ("refused", "passed")])
def test_what_fails_is_no_success(asked: Service, states: tuple[str, str]) -> None:
    asked.states = dict(zip((False, True), states, strict=True))
    assert main(["commission", "left", "--yes"]) == 1
