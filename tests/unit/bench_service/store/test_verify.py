"""All that is stored held against its records, and put right."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.cli.main import main
from bench_service.errors import StoreError
from bench_service.store.integrity import Expected, damage_of
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import ModelOrigin, RunIntent, RunRecord
from bench_service.store.repair import repair
from bench_service.store.sample_writer import SampleWriter
from bench_service.store.samples import FILE, SampleReader
from bench_service.store.verify import verify
from tests.unit.bench_service.store.sample_rig import commit, flip_bit


@pytest.fixture
def data_dir(tmp_path: Path) -> Path:
    """A directory with a run of 7200 samples in two sealed chunks, its profile, and a model."""
    with closing(MetadataStore.open(tmp_path)) as store, closing(SampleWriter.open(tmp_path)) as writer:
        profile = store.profiles.add("p", np.array([0.0, 1.0]), np.array([0.0, 0.0]))
        intent: dict[str, Any] = {"bench": "sim", "profile_id": profile.id, "dt_s": 1.0, "initial_soc": 0.5}
        run = store.runs.add(RunIntent(**intent, capacity_Ah=2.0, limits={}, code_version="0"))
        for seq0 in (0, 3600):
            commit(writer, run.id, seq0, 3600)
        closed = writer.close_run(run.id, "completed", None)
        store.runs.end(run.id, "completed", None, n_samples=closed.n_samples, sha256=closed.sha256)
        store.models.add({"a": [1.5, 2]}, ModelOrigin(name="m", structure="full", capacity_Ah=2.0, code_version="0"))
    return tmp_path


def the_run(data_dir: Path) -> RunRecord:
    with closing(MetadataStore.look(data_dir)) as store:
        return store.runs.ended()[0]


def change(data_dir: Path, file: str, statement: str) -> None:
    with closing(sqlite3.connect(data_dir / file)) as link:
        link.execute(statement)
        link.commit()


def test_a_sound_store_is_whole(data_dir: Path) -> None:
    report = verify(data_dir)
    assert (report.n_runs, report.n_samples, report.findings) == (1, 7200, [])


def test_it_reads_beside_a_service_that_writes(data_dir: Path) -> None:
    with closing(MetadataStore.open(data_dir)), closing(SampleWriter.open(data_dir)):
        assert verify(data_dir).findings == []
        with pytest.raises(StoreError, match="is being written by"):
            repair(data_dir, [])


def test_a_flipped_bit_is_turned_back_and_the_run_is_proved_to_be_whole(data_dir: Path) -> None:
    flip_bit(data_dir, "data", byte=1000)
    (finding,) = verify(data_dir).damaged
    run = the_run(data_dir)
    assert (finding.kind, finding.name) == ("run", run.id)
    (done,) = repair(data_dir, [run.id])
    assert (done.whole, done.restored, done.removed, done.samples_lost) == (True, 2, 0, 0)
    assert verify(data_dir).findings == []
    assert the_run(data_dir) == run


def test_times_beside_a_chunk_are_put_right(data_dir: Path) -> None:
    change(data_dir, FILE, "UPDATE chunk SET t0 = t0 - 100")
    assert verify(data_dir).damaged
    assert repair(data_dir, [the_run(data_dir).id])[0].whole
    assert verify(data_dir).findings == []


def test_what_cannot_be_saved_is_taken_out_and_the_record_says_what_is_left(data_dir: Path) -> None:
    change(data_dir, FILE, "UPDATE chunk SET data = zeroblob(500) WHERE seq0 = 0")
    run = the_run(data_dir)
    (done,) = repair(data_dir, [run.id])
    assert (done.whole, done.removed, done.samples_lost) == (False, 1, 3600)
    left = the_run(data_dir)
    assert (left.n_samples, left.sha256 == run.sha256, left.repaired_utc is None) == (3600, False, False)
    assert left.damage == "3600 of 7200 samples are lost, the others are as they were recorded"
    with closing(SampleReader(data_dir)) as reader:
        # Known, and still no whole run: who reads it is told.
        assert damage_of(Expected.of(left), reader.read(run.id)) == left.damage
    report = verify(data_dir)
    assert report.damaged == [] and [finding.known for finding in report.findings] == [True]
    assert sorted(path.suffix for path in (data_dir / "damaged").iterdir()) == [".block", ".json"]


def test_an_emptied_file_of_samples_is_told_and_then_known(data_dir: Path) -> None:
    (data_dir / FILE).write_bytes(b"")
    with closing(SampleWriter.open(data_dir)):
        pass
    assert verify(data_dir).damaged[0].what == "0 of 7200 samples are stored"
    assert repair(data_dir, [the_run(data_dir).id])[0].samples_lost == 7200
    assert verify(data_dir).damaged == [] and the_run(data_dir).n_samples == 0


def test_profiles_and_models_are_read_too(data_dir: Path) -> None:
    change(data_dir, "meta.sqlite", "UPDATE profile SET sha256 = 'x'")
    change(data_dir, "meta.sqlite", """UPDATE model SET document = '{"a": [1.5, 3]}'""")
    assert sorted(finding.kind for finding in verify(data_dir).damaged) == ["model", "profile"]
    with closing(MetadataStore.look(data_dir)) as store:
        with pytest.raises(StoreError, match="damaged in the store"):
            store.models.document(store.models.page()[0].id)
        with pytest.raises(StoreError, match="damaged in the store"):
            store.profiles.points(store.profiles.page()[0].id)


def test_a_file_that_is_no_database_any_more_is_a_finding(data_dir: Path) -> None:
    content = bytearray((data_dir / FILE).read_bytes())
    content[4096:8192] = b"\xa5" * 4096
    (data_dir / FILE).write_bytes(content)
    assert "file" in {finding.kind for finding in verify(data_dir).damaged}


def test_the_command_ends_with_1_on_damage_and_with_0_after_its_repair(
    data_dir: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("BENCH_DATA_DIR", str(data_dir))
    assert main(["verify", "--json"]) == 0
    flip_bit(data_dir, "data", byte=77)
    assert main(["verify"]) == 1
    assert "damaged: 1 runs" in capsys.readouterr().out
    assert main(["verify", "--repair", "--json"]) == 0
    assert '"state": "repaired"' in capsys.readouterr().out
    with closing(MetadataStore.open(data_dir)):
        assert main(["verify", "--repair"]) == 2
    assert "end it before a repair" in capsys.readouterr().err
    monkeypatch.setenv("BENCH_DATA_DIR", str(data_dir / "none"))
    assert main(["verify"]) == 2
