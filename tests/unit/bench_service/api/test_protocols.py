"""Protocols over REST: taken in, looked at on a bench before they are started, and what their runs have moved."""

from __future__ import annotations

import asyncio
import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench_service.api import protocols, run_steps, runs
from bench_service.bench.limits import Limits
from bench_service.campaign.aside import Aside
from bench_service.errors import NotFoundError
from bench_service.store.reading import StreamData
from bench_service.store.records import ProtocolRecord
from bench_service.streams import STEPS, STREAMS
from tests.patience import PATIENCE_S
from tests.unit.bench_service.api.route_rig import MOMENT, AsyncPart, Store, client_of, error_of

RECORD = ProtocolRecord(id="p1", name="test", sha256="abc", n_steps=1, created_utc=MOMENT)
REST = {"step": "rest", "until": {"time_s": 60}}
DOCUMENT: dict[str, Any] = {"schema": "bench-protocol-1", "name": "test", "steps": [REST]}
LIMITS = Limits((2.5, 4.2), (-10.0, 5.0), (-20.0, 60.0), (0.0, 1.0), None, 1e6)


class Benches:
    def get(self, name: str) -> SimpleNamespace:
        if name != "sim":
            raise NotFoundError.of("bench", name)
        return SimpleNamespace(limits=LIMITS, config=SimpleNamespace(capacity_Ah=2.5, chamber=None, chamber_degC=None))


def client() -> tuple[Any, AsyncPart]:
    journal = AsyncPart(write=RECORD)
    answers = {"add": RECORD, "get": RECORD, "document": DOCUMENT, "page": [RECORD]}
    parts = {"journal": journal, "store": Store(protocols=answers), "benches": Benches(), "aside": Aside()}
    return client_of(protocols.router, **parts), journal


def written(journal: AsyncPart) -> dict[str, Any]:
    ((_, (_, _, _, document), _),) = journal.calls
    return document


def test_a_protocol_is_checked_and_stored() -> None:
    service, journal = client()
    answer = service.post("/protocols", json={"document": DOCUMENT})
    assert answer.status_code == 201 and answer.json()["id"] == "p1"
    assert written(journal) == DOCUMENT


def test_a_protocol_of_unicycler_is_stored_as_our_own() -> None:
    service, journal = client()
    method = [{"step": "open_circuit_voltage", "until_time_s": "60"}]
    answer = service.post("/protocols", json={"document": {"record": {"time_s": 1}, "method": method}})
    assert answer.status_code == 201
    assert written(journal)["steps"] == [{"step": "rest", "until": {"time_s": 60.0}}]


def test_a_standard_test_and_a_design_are_made_for_their_bench() -> None:
    service, journal = client()
    body = {"standard_test": "capacity", "parameters": {"rounds": 3}, "bench": "sim"}
    assert service.post("/protocols", json=body).status_code == 201
    assert written(journal)["steps"][0]["count"] == 3
    service, journal = client()
    request = {"initial_soc": 0.5, "duration_s": 20000, "rate_C": 1}
    design = {**DOCUMENT, "steps": [{"step": "design", "request": request}]}
    assert service.post("/protocols", json={"document": design, "bench": "sim"}).status_code == 201
    assert written(journal)["steps"][0]["step"] == "profile"


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ({}, "give one of document, standard_test or protocol_id"),
        ({"document": {**DOCUMENT, "steps": [{"step": "nap"}]}}, "unknown step at steps.0.step"),
        ({"standard_test": "capacity"}, "say for which bench"),
        ({"standard_test": "alchemy", "bench": "sim"}, "no such standard test"),
        ({"document": DOCUMENT, "bench": "other"}, "unknown bench"),
    ],
)
def test_what_is_wrong_is_told(body: dict[str, Any], told: str) -> None:
    service, journal = client()
    answer = service.post("/protocols", json=body)
    assert answer.status_code in (404, 422) and told in error_of(answer)["message"]
    assert journal.calls == []


def test_a_preview_says_what_to_expect() -> None:
    service, _ = client()
    seen = service.post("/protocols/preview", json={"protocol_id": "p1", "bench": "sim"}).json()
    assert seen["duration_s"] == pytest.approx(60, abs=15) and seen["stopped"] is None
    assert [step["law"] for step in seen["steps"]] == ["rest"]
    inner = {"step": "loop", "count": 3, "steps": [REST, REST]}
    looped = {**DOCUMENT, "steps": [REST, {"step": "loop", "count": 2, "steps": [inner, REST]}]}
    seen = service.post("/protocols/preview", json={"document": looped, "bench": "sim"}).json()
    assert [step["most_times"] for step in seen["steps"]] == [1, 6, 6, 2]
    hot = {**DOCUMENT, "steps": [{"step": "constant_current", "rate_C": 4, "until": {"time_s": 9}}]}
    refused = service.post("/protocols/preview", json={"document": hot, "bench": "sim"})
    assert refused.status_code == 422 and error_of(refused)["where"] == ["steps", 0, "rate_C"]


@pytest.mark.parametrize(("duration_s", "times"), [(1e9, 1), (4e5, 3)])
def test_a_design_longer_than_the_bench_runs_is_refused_before_it_is_made(
    monkeypatch: pytest.MonkeyPatch, duration_s: float, times: int
) -> None:
    made: list[float] = []

    def design(request: Any, _rng: Any) -> SimpleNamespace:
        made.append(request.duration_s)
        return SimpleNamespace(time_s=np.array([0.0, 1.0]), current_A=np.array([0.0, 0.0]))

    monkeypatch.setattr("models.design.step_profile", design)
    service, _ = client()
    design_step = {"step": "design", "request": {"initial_soc": 0.5, "duration_s": duration_s}}
    body = {"document": {**DOCUMENT, "steps": [design_step] * times}, "bench": "sim"}
    for address in ("/protocols", "/protocols/preview"):
        answer = service.post(address, json=body)
        assert answer.status_code == 422 and "longer than a run may be" in error_of(answer)["message"]
        assert error_of(answer)["where"] == ["steps", times - 1, "request", "duration_s"]
    assert made == [duration_s] * 2 * (times - 1)


def test_no_preview_is_in_front_of_a_stop() -> None:
    """More previews than there are threads, none of which ends: what needs a thread gets one."""
    aside, open_again = Aside(), threading.Event()

    async def stop() -> str:
        previews = [asyncio.create_task(aside.call(open_again.wait)) for _ in range(100)]
        await asyncio.sleep(0)
        try:
            return await asyncio.wait_for(asyncio.to_thread(lambda: "stopped"), PATIENCE_S)
        finally:
            aside.close()
            open_again.set()
            await asyncio.gather(*previews, return_exceptions=True)

    assert asyncio.run(stop()) == "stopped"


def test_what_is_stored_is_listed() -> None:
    service, _ = client()
    assert service.get("/protocols").json()["protocols"][0]["name"] == "test"
    assert service.get("/protocols/p1").json()["document"] == DOCUMENT


def test_the_library_is_listed() -> None:
    tests = client_of(protocols.tests_router).get("/standard-tests").json()["standard_tests"]
    assert len(tests) >= 12 and all(test["sentence"] and test["parameters"] for test in tests)


def test_steps_and_cycles_of_a_run() -> None:
    columns = {column.name: np.arange(2).astype(column.numpy) + 1 for column in STREAMS[STEPS]}
    columns["mean_voltage_V"] = np.array([np.nan, 3.7])
    data = StreamData(STREAMS[STEPS], columns, np.arange(2), ())
    run = SimpleNamespace(id="r1", continues=None, protocol_id="p1")
    samples = SimpleNamespace(read=lambda run_id, stream: data)
    service = client_of(run_steps.router, store=Store(runs={"get": run}), samples=samples)
    first, second = service.get("/runs/r1/steps").json()["steps"]
    assert (first["step_count"], first["ended_by"], first["mean_voltage_V"]) == (1, "voltage", None)
    assert (second["ended_by"], second["charged_Ah"]) == ("current", 2.0)
    cycles = service.get("/runs/r1/cycles").json()["cycles"]
    assert [cycle["coulombic_efficiency"] for cycle in cycles] == [1.0, 1.0]


def test_only_a_protocol_goes_on_after_an_interruption() -> None:
    body = {"bench": "sim", "profile_id": "p", "dt_s": 1.0, "initial_soc": 0.5, "on_interruption": "resume"}
    answer = client_of(runs.router, runs=AsyncPart(start=RECORD)).post("/runs", json=body)
    assert answer.status_code == 422 and "only a protocol" in error_of(answer)["message"]
