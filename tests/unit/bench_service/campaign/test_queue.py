"""Campaigns that wait their turn."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from bench_service.campaign.estimate import Estimate, played, time_left
from bench_service.campaign.journal import Journal
from bench_service.campaign.live import Broadcaster
from bench_service.campaign.queue import CampaignQueue
from bench_service.errors import BadRequestError, BenchBusyError, ConflictError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import CampaignRecord


class Rig:
    """A store, and a launch that notes what it was given."""

    def __init__(self, store: MetadataStore) -> None:
        self.store, self.launched, self.error = store, [], None
        self.running = False
        self.journal = Journal(store, Broadcaster())
        self.queue = self.made()

    def made(self) -> CampaignQueue:
        return CampaignQueue(self.store, self.journal, self.launch, lambda _: self.running)

    async def launch(self, record: CampaignRecord) -> CampaignRecord:
        if self.error is not None:
            raise self.error
        self.launched.append(record.name)
        return self.store.campaigns.save(replace(record, state="running"))

    def add(self, name: str, state: Any = "queued") -> CampaignRecord:
        given: dict[str, Any] = {"bench": "a", "stage": "run", "stages": [], "request": {}, "code_version": "0"}
        return self.store.campaigns.add(name=name, state=state, done={"given": {}}, **given)

    def ended(self, state: Any) -> CampaignRecord:
        return self.store.campaigns.save(replace(self.add("before", "running"), state=state, message="because"))


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with closing(MetadataStore.open(tmp_path)) as store:
        yield Rig(store)


async def test_the_next_begins_when_one_is_completed_in_the_order_in_which_they_came(rig: Rig) -> None:
    rig.add("first"), rig.add("second")
    await rig.queue.after(rig.ended("completed"))
    assert rig.launched == ["first"]
    await rig.queue.after(rig.ended("completed"))
    assert rig.launched == ["first", "second"]
    await rig.queue.after(rig.ended("completed"))
    await rig.journal.close()


@pytest.mark.parametrize("state", ["stopped", "failed", "interrupted"])
async def test_after_any_other_end_it_waits_until_somebody_says_so_over_a_restart_too(rig: Rig, state: str) -> None:
    rig.add("first")
    await rig.queue.after(rig.ended(state))
    assert rig.launched == []
    told = await rig.queue.to_json("a")
    assert told["held"] and [each["name"] for each in told["waiting"]] == ["first"]
    await rig.journal.write(lambda: None)
    again = rig.made()
    await again.after_restart("a", rig.store.campaigns.last("a"))
    assert rig.launched == [] and await again.held("a")
    await again.start("a")
    assert rig.launched == ["first"]
    with pytest.raises(ConflictError, match="no campaign waits"):
        await again.start("a")
    await rig.journal.close()


async def test_a_service_that_starts_goes_on_with_what_waits_and_not_behind_what_was_cut_off(rig: Rig) -> None:
    rig.add("first")
    await rig.queue.after_restart("a", rig.ended("interrupted"))
    assert rig.launched == [] and "interrupted with the service" in str(await rig.queue.held("a"))
    fresh = rig.made()
    await rig.journal.write(lambda: rig.store.events.add("info", "queue_started", "by somebody", bench="a"))
    await fresh.after_restart("a", rig.ended("completed"))
    assert rig.launched == ["first"]
    await rig.journal.close()


async def test_what_may_not_begin_has_failed_and_what_the_bench_cannot_take_waits(rig: Rig) -> None:
    one, two = rig.add("one"), rig.add("two")
    rig.error = BenchBusyError("a fault is latched")
    await rig.queue.next("a")
    assert rig.store.campaigns.get(one.id).state == "queued" and await rig.queue.held("a")
    rig.error = BadRequestError("outside the limits")
    await rig.queue.start("a")
    assert (rig.store.campaigns.get(one.id).state, rig.store.campaigns.get(two.id).state) == ("failed", "queued")
    assert "outside the limits" in str(await rig.queue.held("a"))
    rig.error, rig.running = None, True
    await rig.queue.start("a")
    assert rig.launched == []
    await rig.journal.close()


def test_time_left_falls_with_what_is_played() -> None:
    told = Estimate(4, 8000.0, 7200.0, "as long as its profile")
    assert "about 2 h of real time" in told.in_words() and told.to_json()["hours"] == 2.0
    assert Estimate(1, 3600.0, None, "lock-step").to_json()["finish_utc"] is None
    done = {"estimate": told.to_json(), "completed": 1}
    done["played"] = played(done, "observe", 0.5, "100 s played")
    assert done["played"] == 1.5 and played(done, "fit", 0.5, "half") == 1.0
    record: Any = type("Record", (), {"done": done, "state": "running"})
    left = time_left(cast(CampaignRecord, record))
    assert left["time_left_s"] == pytest.approx(7200.0 * 2.5 / 4) and left["finish_utc"] > "2026"
    record.state = "completed"
    assert time_left(record)["time_left_s"] is None
