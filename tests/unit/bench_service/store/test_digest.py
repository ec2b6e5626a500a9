"""The hash of a stored run, block by block, is that of its columns as a whole."""

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from bench_service.store import digest
from bench_service.store.sample_writer import SampleWriter
from bench_service.store.samples import SampleReader
from bench_service.streams import content_hash
from tests.unit.bench_service.store.sample_rig import commit, flip_bit

N = 40


def closed_and_whole(folder: Path, *starts: int) -> tuple[str | None, str]:
    with closing(SampleWriter.open(folder)) as writer:
        for seq0 in starts:
            commit(writer, "run", seq0, N)
        found = writer.close_run("run", "completed", None).sha256
    with SampleReader(folder) as reader:
        return found, content_hash(reader.read("run").columns)


@pytest.mark.parametrize("starts", [(0,), (0, 40, 80), (0, 20, 40), (0, 80), ()])
def test_it_is_the_hash_of_the_columns(tmp_path: Path, starts: tuple[int, ...]) -> None:
    """One block, several, some that come twice in part, a hole, nothing."""
    found, whole = closed_and_whole(tmp_path, *starts)
    assert found == whole


def test_long_columns_go_through_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(digest, "_KEPT_BYTES", 64)
    monkeypatch.setattr(digest, "_PIECE_BYTES", 100)
    found, whole = closed_and_whole(tmp_path, *range(0, 400, 40))
    assert found == whole and not [
        file.name for file in tmp_path.iterdir() if "sqlite" not in file.name and "lock" not in file.name
    ]


def test_without_room_for_files_it_is_made_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> Any:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(digest, "_spool", full)
    found, whole = closed_and_whole(tmp_path, 0, 40)
    assert found == whole


def test_a_damaged_block_has_none(tmp_path: Path) -> None:
    with closing(SampleWriter.open(tmp_path)) as writer:
        commit(writer, "run", 0, N)
        flip_bit(tmp_path, "data")
        assert writer.close_run("run", "completed", None).sha256 is None
