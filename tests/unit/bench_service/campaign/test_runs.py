"""Runs that are stopped, or cannot be stored, in the moments in which they start."""

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bench_service.bench.limits import Limits
from bench_service.bench.listener import BenchStatus
from bench_service.bench.request import RunRequest
from bench_service.campaign import runs as tested
from bench_service.campaign.benches import Benches
from bench_service.campaign.live import Broadcaster
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.runs import Runs
from bench_service.errors import BenchBusyError, BenchOfflineError, StoreError
from bench_service.store.records import RunRecord
from tests.patience import holds
from tests.unit.bench_service.api.route_rig import run_record

LIMITS = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.0, 1.0), None, 100.0)
REQUEST = RunRequest("", 0.1, LIMITS, 3.0, np.array([0.0, 9.0]), np.array([2.0, 0.0]), initial_soc=0.5)
ORDER = RunOrder(bench="b", profile_id="p", dt_s=0.1, initial_soc=0.5)


class Bench:
    """A bench, its supervisor and all benches in one."""

    name = "b"
    config = cell = hardware = None
    supervisor = property(lambda self: self)

    def __init__(self) -> None:
        self.status = BenchStatus("idle")
        self.told: list[str] = []
        self.gone = False

    def get(self, _name: str) -> "Bench":
        return self

    def standing(self) -> None:
        return None

    def start_run(self, request: RunRequest) -> None:
        if self.gone:
            raise BenchOfflineError("bench 'b' is offline: gone; check cycler and link")
        self.told.append(f"start {request.run_id}")

    def stop(self, reason: str) -> None:
        self.told.append(f"stop: {reason}")


class Journal:
    """Writes when it is let; what waits is in `waiting`."""

    def __init__(self) -> None:
        self.free = asyncio.Event()
        self.waiting: list[Callable[..., Any]] = []

    async def write(self, function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        self.waiting.append(function)
        await self.free.wait()
        return function(*arguments, **named)

    def post(self, *_: Any) -> None: ...

    def note(self, *_: Any) -> None: ...


class Table:
    """Runs as they are written down."""

    def __init__(self) -> None:
        self.ended: list[tuple[Any, ...]] = []
        self.full: set[str] = set()  # what cannot be written

    def add(self, _intent: Any) -> RunRecord:
        return run_record(id="r1", state="created", bench="b")

    def start(self, run_id: str) -> RunRecord:
        self._write("start")
        return run_record(id=run_id, state="running", bench="b")

    def end(self, *told: Any, **_counts: Any) -> RunRecord:
        self._write("end")
        self.ended.append(told)
        return run_record(id="r1", state=told[1], reason=told[2], bench="b")

    def _write(self, what: str) -> None:
        if what in self.full:
            raise StoreError("database or disk is full")


class Rig:
    """Runs over fake parts."""

    def __init__(self) -> None:
        self.bench, self.journal, self.table = Bench(), Journal(), Table()
        store, nothing = SimpleNamespace(runs=self.table), cast(Any, None)
        self.runs = Runs(cast(Any, store), nothing, cast(Any, self.journal), nothing, "1")
        self.benches = cast(Benches, self.bench)

    def start(self) -> "asyncio.Task[RunRecord]":
        return asyncio.create_task(self.runs.start(self.benches, ORDER))


@pytest.fixture
async def rig(monkeypatch: pytest.MonkeyPatch) -> Rig:
    monkeypatch.setattr(tested, "request_of", lambda *_: REQUEST)
    monkeypatch.setattr(tested.Hardware, "read", classmethod(lambda *_: None))
    return Rig()


@pytest.mark.parametrize("by", ["bench", "run", "past the service"])
async def test_a_stop_that_comes_while_the_intent_is_written_ends_the_run_before_its_first_tick(
    rig: Rig, by: str
) -> None:
    starting = rig.start()
    await holds(lambda: rig.journal.waiting, "the intent is being written")
    if by == "bench":
        rig.runs.stop_bench(rig.benches, "b", "by a person")
    elif by == "past the service":
        benches = Benches(Broadcaster(), lambda *_: None, rig.runs.on_ended, rig.runs.on_stop)
        benches.add([cast(Any, rig.bench)])
        benches.on_event("b", {"severity": "info", "code": "stop_asked", "text": "by a person", "run_id": None})
    else:
        rig.runs.stop(rig.benches, run_record(id="r1", state="created", bench="b"), "by a person")
    rig.journal.free.set()
    assert (await starting).id == "r1"
    # Right behind the start, on the same link: the control process ends it before its first tick.
    at = rig.bench.told.index("start r1")
    assert rig.bench.told[at + 1] == "stop: by a person"


async def test_a_stop_that_came_before_it_or_for_another_bench_is_not_for_it(rig: Rig) -> None:
    rig.runs.stop_bench(rig.benches, "b", "too early")
    starting = rig.start()
    await holds(lambda: rig.journal.waiting, "the intent is being written")
    rig.runs.stop(rig.benches, run_record(id="r2", state="created", bench="c"), "another bench")
    rig.journal.free.set()
    await starting
    assert rig.bench.told == ["stop: too early", "start r1"]


async def test_a_run_whose_start_cannot_be_stored_is_not_played(rig: Rig) -> None:
    rig.journal.free.set()
    rig.table.full = {"start"}
    with pytest.raises(StoreError, match="disk is full"):
        await rig.start()
    assert rig.bench.told == []
    assert rig.table.ended == [("r1", "fault", "not started: database or disk is full")]
    rig.table.full.clear()
    await rig.start()
    assert rig.bench.told == ["start r1"]


async def test_a_bench_is_free_again_when_the_end_of_a_run_that_was_not_started_can_be_stored(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tested, "_RETRY_S", 0.01)
    rig.journal.free.set()
    rig.table.full, rig.bench.gone = {"end"}, True
    with pytest.raises(BenchOfflineError, match="is offline: gone"):
        await rig.start()
    with pytest.raises(BenchBusyError):
        await rig.start()
    rig.table.full.clear()
    await holds(lambda: rig.table.ended, "the end is stored")
    rig.bench.gone = False
    await rig.start()
    assert rig.bench.told == ["start r1"]
