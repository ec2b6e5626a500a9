"""What is read of a run held against what its record promises."""

import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from bench_service.errors import DamagedError, StoreError
from bench_service.store.integrity import Expected, damage_of, read_part, read_whole
from bench_service.store.sample_writer import SampleWriter
from bench_service.store.samples import FILE, ClosedRun, SampleReader
from bench_service.streams import OBSERVER, SAMPLES
from tests.unit.bench_service.store.sample_rig import commit, flip_bit


class Files:
    """A data directory with one run of 300 samples in three chunks."""

    def __init__(self, data_dir: Path, stack: ExitStack) -> None:
        self.data_dir = data_dir
        with closing(SampleWriter.open(data_dir)) as writer:
            for seq0 in (0, 100, 200):
                commit(writer, "r1", seq0, 100)
            self.closed: ClosedRun = writer.close_run("r1", "completed", None)
        self.samples = stack.enter_context(closing(SampleReader(data_dir)))
        self.expected = Expected("r1", 300, self.closed.sha256)


@pytest.fixture
def files(tmp_path: Path) -> Iterator[Files]:
    with ExitStack() as stack:
        yield Files(tmp_path / "data", stack)


def test_a_whole_run_is_read(files: Files) -> None:
    assert read_whole(files.samples, files.expected).n == 300
    data, damage = read_part(files.samples, files.expected, SAMPLES, 10.0, 20.0)
    assert (data.n, damage) == (11, None)


def test_a_flipped_bit_is_told(files: Files) -> None:
    flip_bit(files.data_dir, "data")
    with pytest.raises(DamagedError, match="300 of 300 samples cannot be read.*checksum"):
        read_whole(files.samples, files.expected)


@pytest.mark.parametrize("column", ["t0", "t1", "n", "seq0", "crc"])
def test_what_stands_beside_a_chunk_is_watched_too(files: Files, column: str) -> None:
    with closing(sqlite3.connect(files.data_dir / FILE)) as link:
        link.execute(f"UPDATE chunk SET {column} = {column} + 1")
        link.commit()
    assert damage_of(files.expected, files.samples.read("r1")) is not None


def test_a_chunk_that_is_gone_is_told_by_the_count(files: Files) -> None:
    with closing(sqlite3.connect(files.data_dir / FILE)) as link:
        link.execute("DELETE FROM chunk")
        link.commit()
    with pytest.raises(DamagedError, match="run r1 is damaged: 0 of 300 samples are stored; restore a backup"):
        read_whole(files.samples, files.expected)
    assert read_part(files.samples, files.expected, OBSERVER, None, None)[1] == "0 of 300 samples are stored"


def test_other_samples_are_told_by_the_hash(files: Files) -> None:
    other = Expected("r1", 300, "f" * 64)
    assert damage_of(other, files.samples.read("r1")) is not None
    assert damage_of(Expected("r1", 300, None), files.samples.read("r1")) is None


def test_a_file_that_is_removed_or_replaced_is_not_read_from_memory(files: Files, tmp_path: Path) -> None:
    assert files.samples.n_rows("r1") == 300
    files.data_dir.rename(tmp_path / "aside")
    with pytest.raises(StoreError, match="is gone"):
        files.samples.read("r1")
    with closing(SampleWriter.open(files.data_dir)):
        assert damage_of(files.expected, files.samples.read("r1")) == "0 of 300 samples are stored"
    files.data_dir.rename(tmp_path / "other")
    (tmp_path / "aside").rename(files.data_dir)
    assert read_whole(files.samples, files.expected).n == 300


def test_samples_beyond_those_acknowledged_are_no_damage_where_no_recorder_has_counted(files: Files) -> None:
    data = files.samples.read("r1")
    assert damage_of(Expected("r1", 250, None), data) is None
    assert damage_of(Expected("r1", 350, None), data) == "300 of 350 samples are stored"
    assert read_part(files.samples, Expected("r1", 250, None), SAMPLES, 1.0, None)[1] is None
    assert read_part(files.samples, Expected("r1", 250, "x"), SAMPLES, 1.0, None)[1] is not None
