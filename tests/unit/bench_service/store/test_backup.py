"""Copies of what is stored, put back; and samples that are given up."""

import sqlite3
import stat
from contextlib import closing
from pathlib import Path

import pytest

from bench_service.cli.main import main
from bench_service.errors import ConflictError, StoreError
from bench_service.store.backup import put_back, take
from bench_service.store.metadata import MetadataStore
from bench_service.store.retention import give_up, old_runs
from bench_service.store.sample_writer import SampleWriter
from bench_service.store.samples import FILE, SampleReader
from bench_service.store.verify import verify
from tests.unit.bench_service.store.sample_rig import commit, flip_bit
from tests.unit.bench_service.store.test_verify import data_dir, the_run

__all__ = ["data_dir"]


def test_a_copy_is_taken_while_both_files_are_written_and_is_whole(data_dir: Path, tmp_path: Path) -> None:
    with closing(MetadataStore.open(data_dir)) as store, closing(SampleWriter.open(data_dir)) as writer:
        commit(writer, "going on", 0, 100)
        copy = take(data_dir, tmp_path / "copies" / "one")
        commit(writer, "going on", 100, 100)
        store.events.add("info", "later", "not in the copy")
    assert (copy.report.n_runs, copy.report.n_samples, copy.report.findings) == (1, 7200, [])
    assert stat.S_IMODE(copy.path.stat().st_mode) == 0o700
    back = put_back(copy.path, tmp_path / "back")
    assert back.report.findings == [] and the_run(tmp_path / "back") == the_run(data_dir)
    with closing(SampleReader(tmp_path / "back")) as reader:
        assert reader.n_rows("going on") == 100
    with closing(MetadataStore.open(tmp_path / "back")) as store:
        assert store.events.page() == []


def test_nothing_is_written_over_and_nothing_that_is_in_use(data_dir: Path, tmp_path: Path) -> None:
    copy = take(data_dir, tmp_path / "copy")
    with pytest.raises(ConflictError, match="is there already"):
        take(data_dir, tmp_path / "copy")
    with pytest.raises(ConflictError, match="holds data already"):
        put_back(copy.path, data_dir)
    with closing(MetadataStore.open(tmp_path / "used")), pytest.raises(ConflictError, match="has .*used open"):
        put_back(copy.path, tmp_path / "used")
    with pytest.raises(StoreError, match="nothing is stored"):
        take(tmp_path / "none", tmp_path / "other")


def test_a_copy_that_is_not_as_it_was_taken_is_not_put_back(data_dir: Path, tmp_path: Path) -> None:
    copy = take(data_dir, tmp_path / "copy")
    content = bytearray((copy.path / FILE).read_bytes())
    content[-100] ^= 1
    (copy.path / FILE).write_bytes(content)
    with pytest.raises(StoreError, match="not as it was copied"):
        put_back(copy.path, tmp_path / "back")
    assert not (tmp_path / "back").exists()
    with pytest.raises(StoreError, match="is no copy"):
        put_back(tmp_path, tmp_path / "back")


def test_a_copy_of_what_is_damaged_says_so(data_dir: Path, tmp_path: Path) -> None:
    flip_bit(data_dir, "data")
    assert take(data_dir, tmp_path / "copy").to_json()["state"] == "damaged"


def test_old_samples_go_and_the_record_says_so(data_dir: Path) -> None:
    run = the_run(data_dir)
    with closing(MetadataStore.look(data_dir)) as store:
        assert old_runs(store, 1.0).runs == []
    with closing(sqlite3.connect(data_dir / "meta.sqlite")) as link:
        link.execute("UPDATE run SET ended_utc = '2020-01-01T00:00:00.000000Z'")
        link.commit()
    size = (data_dir / FILE).stat().st_size
    assert [each.id for each in give_up(data_dir, 30.0).runs] == [run.id]
    assert (data_dir / FILE).stat().st_size < size
    with closing(MetadataStore.look(data_dir)) as store, closing(SampleReader(data_dir)) as reader:
        assert store.runs.get(run.id).removed_utc and reader.n_rows(run.id) == 0
    assert verify(data_dir).findings == []
    assert give_up(data_dir, 30.0).runs == []


def test_samples_that_a_model_rests_on_stay(data_dir: Path) -> None:
    run = the_run(data_dir)
    with closing(sqlite3.connect(data_dir / "meta.sqlite")) as link:
        link.execute("UPDATE run SET ended_utc = '2020-01-01T00:00:00.000000Z'")
        link.execute("UPDATE model SET train = ?", (f'[{{"run_id": "{run.id}", "sha256": null}}]',))
        link.commit()
    old = give_up(data_dir, 30.0)
    assert (old.runs, old.n_kept) == ([], 1)


def test_the_commands(
    data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("BENCH_DATA_DIR", str(data_dir))
    assert main(["backup", str(tmp_path / "copy")]) == 0
    assert "7200 samples" in capsys.readouterr().out
    assert main(["restore", str(tmp_path / "copy")]) == 2
    assert main(["retain", "--days", "10", "--json"]) == 0
    assert '"state": "listed"' in capsys.readouterr().out
    monkeypatch.setenv("BENCH_DATA_DIR", str(tmp_path / "new"))
    assert main(["restore", str(tmp_path / "copy"), "--json"]) == 0
    assert main(["verify"]) == 0
