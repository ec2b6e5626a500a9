"""A data directory that goes away under the service, and its room."""

from pathlib import Path

import pytest

from bench_service.bench.recording import QUEUE_S, SEAL_S
from bench_service.bench.supervisor import QUIT_S
from bench_service.errors import StoreError
from bench_service.store import watch
from bench_service.store.sample_writer import SampleWriter
from bench_service.store.watch import FolderWatch, Room, check_writable_folder
from tests.unit.bench_service.store.sample_rig import commit


def test_a_directory_that_stays_is_fine(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("")
    FolderWatch(tmp_path, "a").check()
    check_writable_folder(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_what_is_removed_or_replaced_is_told_and_what_comes_back_is_the_same(tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    (data / "a").write_text("")
    seen = FolderWatch(data, "a")
    data.rename(tmp_path / "aside")
    with pytest.raises(StoreError, match="data is gone"):
        seen.check()
    data.mkdir()
    (data / "a").write_text("")
    with pytest.raises(StoreError, match="data is not the one"):
        seen.check()
    (data / "a").unlink()
    data.rmdir()
    (tmp_path / "aside").rename(data)
    seen.check()
    (data / "a").rename(data / "b")
    with pytest.raises(StoreError, match="a is gone"):
        seen.check()


def test_room_is_held_against_the_floor(tmp_path: Path) -> None:
    seen = FolderWatch(tmp_path)
    assert not seen.room(1).short and seen.room(10**18).short
    assert Room(5_000_000, 200_000_000).in_words() == "5 MB free, floor 200 MB"


def test_a_directory_that_takes_nothing_is_told(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="cannot write to"):
        check_writable_folder(tmp_path / "not there")


def test_nothing_is_acknowledged_once_the_directory_is_gone(tmp_path: Path) -> None:
    data = tmp_path / "data"
    writer = SampleWriter.open(data)
    commit(writer, "r1", 0, 10)
    data.rename(tmp_path / "aside")
    with pytest.raises(StoreError, match="data is gone"):
        commit(writer, "r1", 10, 10)
    data.mkdir()
    with pytest.raises(StoreError, match="cannot store samples: .*data is not the one that the service has opened"):
        commit(writer, "r1", 20, 10)
    writer.close()


def test_nothing_is_stored_on_a_disk_that_is_all_but_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = SampleWriter.open(tmp_path)
    commit(writer, "r1", 0, 10)
    monkeypatch.setattr(watch.shutil, "disk_usage", lambda _: type("Usage", (), {"free": 3_000_000}))
    with pytest.raises(StoreError, match="the disk is full \\(3 MB free, floor 16 MB\\)"):
        commit(writer, "r1", 10, 10)
    writer.close()


def test_a_file_of_samples_that_somebody_holds_for_half_a_minute_costs_none(tmp_path: Path) -> None:
    """Each waits longer than what it waits for, and the queue holds what is measured meanwhile."""
    writer = SampleWriter.open(tmp_path)
    with writer._engine.begin() as link:
        waits_s = link.exec_driver_sql("PRAGMA busy_timeout").scalar_one() / 1000.0
    writer.close()
    assert 30.0 < waits_s < SEAL_S < min(QUIT_S, QUEUE_S)
