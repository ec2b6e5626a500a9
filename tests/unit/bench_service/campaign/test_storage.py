"""The state of the data directory: what is told, and when no run is taken."""

import asyncio
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from bench_service.campaign.journal import Journal
from bench_service.campaign.live import Broadcaster
from bench_service.campaign.storage import BYTES_PER_SAMPLE, Storage
from bench_service.errors import NoRoomError, StoreError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent, RunRecord
from bench_service.store.sample_writer import SampleWriter
from bench_service.store.samples import SampleReader
from bench_service.store.watch import FolderWatch
from tests.patience import PATIENCE_S
from tests.unit.bench_service.store.sample_rig import commit, flip_bit


class Rig:
    """A data directory with runs, and the storage over it."""

    def __init__(self, data_dir: Path, stack: ExitStack) -> None:
        self.data_dir = data_dir
        self.store = stack.enter_context(closing(MetadataStore.open(data_dir)))
        self.writer = stack.enter_context(closing(SampleWriter.open(data_dir)))
        self.samples = stack.enter_context(closing(SampleReader(data_dir)))
        self.recorder = "running"
        self.floor = 0
        self.told: list[str] = []

    def run(self) -> RunRecord:
        profile = self.store.profiles.add("p", np.array([0.0, 1.0]), np.array([0.0, 0.0]))
        intent: dict[str, Any] = {"bench": "sim", "profile_id": profile.id, "dt_s": 1.0, "initial_soc": 0.5}
        run = self.store.runs.add(RunIntent(**intent, capacity_Ah=2.0, limits={}, code_version="0"))
        commit(self.writer, run.id, 0, 50)
        closed = self.writer.close_run(run.id, "completed", None)
        return self.store.runs.end(run.id, "completed", None, n_samples=50, sha256=closed.sha256)

    async def started(self) -> tuple[Storage, Journal]:
        journal = Journal(self.store, cast(Broadcaster, self))
        watch = FolderWatch(self.data_dir, "meta.sqlite", "samples.sqlite")
        storage = Storage(self.store, self.samples, journal, watch, lambda: self.recorder, self.floor)
        await storage.start()
        return storage, journal

    def publish(self, message: dict[str, Any]) -> None:
        self.told.insert(0, message["code"])

    def events(self) -> list[str]:
        return self.told


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with ExitStack() as stack:
        yield Rig(tmp_path / "data", stack)


async def until(condition: Any) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            await asyncio.sleep(0.01)


async def test_a_sound_store_says_so(rig: Rig) -> None:
    rig.run()
    storage, journal = await rig.started()
    told = storage.to_json()
    assert (told["state"], told["damaged_runs"], told["floor_MB"]) == ("ok", 0, 0) and told["free_MB"] > 0
    storage.refuse(1000)
    await storage.close()
    await journal.close()
    assert rig.events() == []


@pytest.mark.parametrize("what", ["bit", "emptied"])
async def test_what_was_damaged_before_the_start_is_found_at_it_and_what_is_whole_again_too(
    rig: Rig, what: str
) -> None:
    run = rig.run()
    if what == "bit":
        flip_bit(rig.data_dir, "data")
    else:
        with rig.writer._engine.begin() as link:  # noqa: SLF001
            link.exec_driver_sql("DELETE FROM chunk")
    storage, journal = await rig.started()
    await until(lambda: storage.to_json()["damaged_runs"] == 1)
    await until(lambda: rig.events() == ["run_damaged"])
    # Whoever reads all runs in the background must not find it damaged once more after it was said to be whole.
    await until(storage._tasks[1].done)  # noqa: SLF001
    noted = rig.store.runs.get(run.id)
    assert noted.damage is not None
    storage.note_damage(noted, noted.damage)
    storage.note_damage(noted, None)
    await until(lambda: rig.events() == ["run_whole", "run_damaged"])
    assert storage.to_json()["damaged_runs"] == 0
    await storage.close()
    await journal.close()


async def test_no_run_is_taken_where_there_is_no_room_for_it_and_the_figures_are_told(rig: Rig) -> None:
    storage, journal = await rig.started()
    free = storage.room().free
    with pytest.raises(NoRoomError, match="MB free, floor 0 MB, and .* samples take up to .* MB; make room"):
        storage.refuse(free // BYTES_PER_SAMPLE + 10**6)
    rig.floor = 10**18
    short, second = await rig.started()
    with pytest.raises(NoRoomError, match="floor 1000000000000 MB"):
        short.refuse(1)
    assert "nearly full" in str(short.problem())
    for each in (storage, short):
        await each.close()
    for each in (journal, second):
        await each.close()


async def test_no_run_is_taken_while_recorder_or_directory_are_gone_and_both_ends_are_events(rig: Rig) -> None:
    storage, journal = await rig.started()
    rig.recorder = "cannot store samples"
    with pytest.raises(StoreError, match="nothing can be recorded: cannot store samples"):
        storage.refuse(1)
    rig.recorder = "running"
    rig.data_dir.rename(rig.data_dir.with_name("aside"))
    with pytest.raises(StoreError, match="data is gone"):
        storage.refuse(1)
    assert "is gone" in storage.to_json()["state"]
    await until(lambda: rig.events() == ["storage"])
    rig.data_dir.with_name("aside").rename(rig.data_dir)
    storage.refuse(1)
    await until(lambda: rig.events() == ["storage_back", "storage"])
    await storage.close()
    await journal.close()
