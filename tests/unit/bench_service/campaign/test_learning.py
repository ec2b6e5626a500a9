"""A bench that learns: versions are kept one after the other, the newest is used, and an event says what came of it."""

import asyncio
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from bench_service.campaign.learning import Learning, LearningOrder
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.versions import chain
from bench_service.errors import BadRequestError
from bench_service.jobs.runner import Job
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunRecord
from tests.unit.bench_service.test_diagnoses_store import add_model, add_run


def version(run_id: str, number: int, made: bool = True) -> dict[str, Any]:
    metrics = {"learned_from": run_id, "error_before_mV": 2.0 + number, "remark": f"remark {number}"}
    metrics |= {"noise_floor_mV": 1.0, "effect": None}
    document = {"n": number} if made else None
    common = {"run_id": run_id, "structure": "minimal", "capacity_Ah": 2.5 - 0.1 * number}
    return common | {"document": document, "number": number, "metrics": metrics}


class House:
    """A store, jobs that are done with what a test says, runs that have ended, and a journal that is kept."""

    def __init__(self, store: MetadataStore) -> None:
        self.store, self.noted, self.result = store, list[Any](), dict[str, Any]()
        self.started, self._kept = list[RunOrder](), dict[str, Any]()
        self.learning = Learning(store, self, self, self, self, (Path(), "1"))  # pyright: ignore[reportArgumentType]

    def inputs(self, run_ids: list[str], _field: str, _soc: float | None) -> list[str]:
        return run_ids

    def submit(self, _kind: str, _function: Any, *_arguments: Any, store: Any) -> Job:
        self._kept = store(self.result)
        return Job(id="j1", kind="learn")

    async def wait(self, of: str) -> Job | RunRecord:
        return Job(id="j1", kind="learn", state="done", result=self._kept) if of == "j1" else self.store.runs.get(of)

    async def start(self, _benches: Any, order: RunOrder) -> RunRecord:
        self.started.append(order)
        return self.store.runs.get(str(order.name))

    def note(self, bench: str, event: Any, _campaign: Any) -> None:
        self.noted.append((bench, event["code"], event["text"]))


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    with closing(MetadataStore.open(tmp_path)) as store:
        yield House(store)


def test_versions_follow_one_another_and_each_next_run_judges_the_one_before(house: House) -> None:
    first, runs = add_model(house.store, "cell"), [add_run(house.store) for _ in range(3)]
    house.result = {"versions": [version(runs[0], 2), version(runs[1], 2, made=False), version(runs[2], 3)]}
    asyncio.run(house.learning.start_learning(LearningOrder(model_id=first, run_ids=runs)))
    told = asyncio.run(house.wait("j1")).result  # pyright: ignore
    made = [each["model"] for each in told["versions"]]
    assert made[1] is None and told["model"] == made[2]
    last = house.store.models.get(made[2])
    assert (last.name, last.parent_id, last.capacity_Ah) == ("cell, version 3", made[0], pytest.approx(2.2))
    assert [house.learning.newest(each) for each in (first, made[0], made[2])] == [made[2]] * 3
    found = {each["id"]: each["held_out"] for each in chain(house.store, made[2])["models"]}
    assert (found[first]["rmse_mV"], found[first]["run_ids"]) == (4.0, [runs[0]])
    assert (found[made[0]]["rmse_mV"], found[made[0]]["run_ids"]) == (5.0, [runs[2]])
    assert found[made[2]] is None


def test_a_run_uses_the_newest_version_and_is_learned_from_when_it_is_completed(house: House) -> None:
    first, runs = add_model(house.store, "cell"), [add_run(house.store) for _ in range(2)]

    async def play(run: str, number: int) -> None:
        house.result = {"versions": [version(run, number)]}
        order = RunOrder(bench="b", profile_id="p", dt_s=1.0, initial_soc=0.5, name=run, model_id=first)
        await house.learning.start_run(None, order)  # pyright: ignore[reportArgumentType]
        for _ in range(200):
            await asyncio.sleep(0.01)
            if len(house.noted) == number - 1:
                return

    for number, run in enumerate(runs, start=2):
        asyncio.run(play(run, number))
    second = house.store.models.family(first)[1].id
    assert [order.model_id for order in house.started] == [first, second]
    assert [(bench, code) for bench, code, _ in house.noted] == [("b", "model_learned")] * 2
    assert house.noted[1][2].endswith("learned from the run: remark 3")


def test_what_cannot_be_learned_is_refused(house: House) -> None:
    first, run = add_model(house.store, "cell"), add_run(house.store)
    with pytest.raises(BadRequestError, match="would teach and judge"):
        asyncio.run(house.learning.start_learning(LearningOrder(model_id=first, run_ids=[run], validate_run_ids=[run])))
    order = RunOrder(bench="b", profile_id="p", dt_s=1.0, initial_soc=0.5)
    with pytest.raises(BadRequestError, match="needs a model"):
        asyncio.run(house.learning.start_run(None, order))  # pyright: ignore[reportArgumentType]
