import errno
import hashlib
import json
import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

from bench_service.errors import ConflictError, NotFoundError, StoreError
from bench_service.store import engine as engines
from bench_service.store import migrate, schema
from bench_service.store.interrupted import mark_interrupted_runs
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import ModelOrigin, RunIntent, RunReference
from bench_service.store.sample_writer import Rows, SampleWriter
from bench_service.store.samples import SampleReader
from bench_service.streams import Column

LIMITS = {"voltage_V": [2.5, 4.2], "current_A": [-3.0, 3.0], "ramp_A_per_s": None}


class Clock:
    """A second passes with every look."""

    def __init__(self) -> None:
        self.now = datetime(2026, 1, 1, 12, tzinfo=UTC)

    def __call__(self) -> datetime:
        self.now += timedelta(seconds=1)
        return self.now


@pytest.fixture
def store(tmp_path):
    with closing(MetadataStore.open(tmp_path / "data", clock=Clock())) as opened:
        yield opened


def add_profile(store):
    return store.profiles.add("pulse", np.array([0.0, 3600.0, 7200.0]), np.array([1.0, -3.0, 0.0]))


def add_run(store, **changes):
    values = {
        "bench": "sim",
        "profile_id": add_profile(store).id,
        "dt_s": 0.1,
        "initial_soc": 0.5,
        "capacity_Ah": 3.0,
        "limits": LIMITS,
        "code_version": "0.1.0",
    }
    return store.runs.add(RunIntent(**values | changes))


def test_a_profile_is_summed_up_and_its_points_come_back(store):
    profile = add_profile(store)
    assert (profile.n_points, profile.duration_s, profile.current_A) == (3, 7200.0, (-3.0, 1.0))
    assert profile.charge_Ah == (-2.0, -2.0, 1.0)
    assert profile.created_utc == "2026-01-01T12:00:01.000000Z"
    assert store.profiles.get(profile.id) == profile
    time_s, current_A = store.profiles.points(profile.id)
    np.testing.assert_array_equal(time_s, [0.0, 3600.0, 7200.0])
    np.testing.assert_array_equal(current_A, [1.0, -3.0, 0.0])
    assert store.profiles.page() == [profile]


@pytest.mark.parametrize("kind", ["profile", "run", "model", "comparison", "campaign"])
def test_unknown_ids_are_named(store, kind):
    with pytest.raises(NotFoundError, match=f"unknown {kind} 'nope'"):
        getattr(store, f"{kind}s").get("nope")


def test_a_run_goes_from_created_to_its_end_once(store):
    run = add_run(store, seed=7, name="first")
    assert (run.state, run.started_utc, run.limits) == ("created", None, LIMITS)
    assert store.runs.get(run.id) == run
    started = store.runs.start(run.id)
    assert (started.state, started.started_utc is None) == ("running", False)
    with pytest.raises(ConflictError, match="is running and cannot become running"):
        store.runs.start(run.id)
    ended = store.runs.end(run.id, "completed", None, n_samples=10, missed_ticks=0, sha256="ab" * 32)
    assert (ended.state, ended.n_samples, ended.missed_ticks, ended.sha256) == ("completed", 10, 0, "ab" * 32)
    with pytest.raises(ConflictError, match="is completed and cannot become fault"):
        store.runs.end(run.id, "fault", "late")
    assert store.runs.get(run.id) == ended
    with pytest.raises(NotFoundError):
        store.runs.start("nope")


def test_a_run_needs_its_profile(store):
    with pytest.raises(ConflictError, match="FOREIGN KEY"):
        add_run(store, profile_id="nope")
    assert store.runs.page() == []


def test_lists_are_filtered_and_come_in_pages_newest_first(store):
    runs = [add_run(store, bench=bench) for bench in ("a", "b", "a", "a")]
    store.runs.start(runs[3].id)
    assert [run.id for run in store.runs.page()] == [run.id for run in reversed(runs)]
    assert [run.id for run in store.runs.page(limit=2, offset=1)] == [runs[2].id, runs[1].id]
    assert [run.id for run in store.runs.page(bench="b")] == [runs[1].id]
    assert [run.id for run in store.runs.page(bench="a", state="created")] == [runs[2].id, runs[0].id]
    assert store.runs.page(campaign_id="none") == []


def test_models_and_comparisons_name_their_inputs(store):
    run = add_run(store)
    store.runs.end(run.id, "completed", None, n_samples=5, sha256="cd" * 32)
    train = store.runs.references([run.id])
    assert train == (RunReference(run.id, "cd" * 32),)
    document = {"schema": 1, "weights": [0.1, -2.5]}
    model = store.models.add(
        document, ModelOrigin(name="m", structure="full", capacity_Ah=3.0, code_version="0.1.0", train=train, seed=1)
    )
    assert store.models.get(model.id) == model
    assert store.models.document(model.id) == document
    assert store.models.page() == [model]
    child = store.models.add(
        {"schema": 1},
        ModelOrigin(name="n", structure="full", capacity_Ah=3.0, code_version="0.1.0", parent_id=model.id),
    )
    assert store.models.get(child.id).parent_id == model.id
    compared = store.comparisons.add(model.id, train, {"overall": {"rmse_mV": 3.5}}, code_version="0.1.0")
    assert store.comparisons.get(compared.id) == compared
    assert compared.run_ids == (run.id,)
    assert (store.comparisons.page(model.id), store.comparisons.page(child.id)) == ([compared], [])


def test_nan_does_not_get_into_a_document(store):
    with pytest.raises(StoreError, match="not JSON compliant"):
        store.models.add(
            {"bias": float("nan")}, ModelOrigin(name="m", structure="full", capacity_Ah=3.0, code_version="0.1.0")
        )
    assert store.models.page() == []


def test_a_campaign_is_saved_as_it_goes(store):
    stages = [{"name": "design", "state": "running", "detail": "", "seconds": None}]
    campaign = store.campaigns.add(
        name="c", bench="sim", stage="design", stages=stages, request={"seed": 1}, code_version="0.1.0"
    )
    assert store.campaigns.get(campaign.id) == campaign
    moved = store.campaigns.save(replace(campaign, stage="run", progress=0.25, message="playing"))
    assert store.campaigns.get(campaign.id) == moved
    assert moved.ended_utc is None
    done = store.campaigns.save(replace(moved, state="completed", stage="done", result={"ok": True}))
    assert done.ended_utc is not None
    assert store.campaigns.page() == [done]
    with pytest.raises(NotFoundError):
        store.campaigns.save(replace(campaign, id="nope"))


def test_events_are_listed_newest_first(store):
    first = store.events.add("info", "started", "run started", bench="sim", run_id="r1")
    second = store.events.add("error", "trip", "voltage 4.3 V above 4.2 V", run_id="r2")
    assert store.events.page() == [second, first]
    assert store.events.page(run_id="r1") == [first]
    assert store.events.page(limit=1) == [second]


def test_open_runs_and_campaigns_are_interrupted_at_start_with_what_is_stored(store, tmp_path):
    data = tmp_path / "data"
    campaign = store.campaigns.add(name="c", bench="sim", stage="run", stages=[], request={}, code_version="0.1.0")
    lost, closed, created, completed = (add_run(store) for _ in range(4))
    for run in (lost, closed, completed):
        store.runs.start(run.id)
    store.runs.end(completed.id, "completed", None, n_samples=1)
    layout = (Column("time_s", "f8"),)
    with closing(SampleWriter.open(data)) as writer:
        writer.commit([Rows(lost.id, "samples", 0, layout, {"time_s": np.arange(7.0)})])
        writer.commit([Rows(closed.id, "samples", 0, layout, {"time_s": np.arange(5.0)})])
        end = writer.close_run(closed.id, "fault", "over-voltage")
    with closing(SampleReader(data)) as samples:
        ended = {run.id: run for run in mark_interrupted_runs(store, samples)}
        assert mark_interrupted_runs(store, samples) == []
    assert ended.keys() == {lost.id, closed.id, created.id}
    assert (ended[lost.id].state, ended[lost.id].n_samples) == ("interrupted", 7)
    assert ended[lost.id].sha256 == hashlib.sha256(np.arange(7.0).tobytes()).hexdigest()
    assert (ended[created.id].state, ended[created.id].n_samples) == ("interrupted", 0)
    assert (ended[closed.id].state, ended[closed.id].reason) == ("fault", "over-voltage")
    assert (ended[closed.id].n_samples, ended[closed.id].sha256) == (5, end.sha256)
    assert store.runs.get(completed.id).state == "completed"
    assert store.campaigns.get(campaign.id).state == "interrupted"


def test_a_second_writer_is_refused_and_told_whom_to_ask(store, tmp_path):
    store.announce("http://127.0.0.1:8000")
    program = (
        "import sys; from pathlib import Path\n"
        "from bench_service.errors import StoreError\n"
        "from bench_service.store.metadata import MetadataStore\n"
        "try: MetadataStore.open(Path(sys.argv[1]))\n"
        "except StoreError as error: print(error.message)\n"
    )
    said = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "data")], capture_output=True, text=True, check=True
    ).stdout
    assert f"is being written by process {os.getpid()}, service at http://127.0.0.1:8000" in said
    assert "meta.sqlite" in said
    with pytest.raises(StoreError, match="is being written"):
        MetadataStore.open(tmp_path / "data")


def test_the_holder_is_known_until_it_goes(tmp_path):
    assert MetadataStore.holder(tmp_path) is None
    store = MetadataStore.open(tmp_path, url="http://127.0.0.1:8001")
    holder = MetadataStore.holder(tmp_path)
    assert holder is not None
    assert (holder.pid, holder.url) == (os.getpid(), "http://127.0.0.1:8001")
    store.close()
    assert MetadataStore.holder(tmp_path) is None
    MetadataStore.open(tmp_path).close()


def test_writes_are_durable_and_readers_cannot_write(store, tmp_path):
    with store._file.write() as link:
        pragma = {
            name: link.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous", "mmap_size", "foreign_keys")
        }
    assert pragma == {"journal_mode": "wal", "synchronous": 2, "mmap_size": 0, "foreign_keys": 1}
    reader = engines.open_reader(tmp_path / "data" / "meta.sqlite")
    with pytest.raises(Exception, match="readonly"), reader.begin() as link:
        link.execute(schema.event.delete())
    reader.dispose()


@pytest.mark.parametrize("database", ["meta", "samples"])
def test_revisions_lead_to_the_tables_of_the_code(tmp_path, database):
    engine = engines.open_writer(tmp_path / "x.sqlite")
    migrate.upgrade(engine, database)
    assert ScriptDirectory(
        str(migrate.directory(database).parent), version_locations=[str(migrate.directory(database))]
    ).get_heads() == [migrate.HEAD[database]]
    metadata = {"meta": schema.META, "samples": schema.SAMPLES}[database]
    with engine.begin() as link:
        context = MigrationContext.configure(link, opts={"compare_type": True, "render_as_batch": True})
        assert compare_metadata(context, metadata) == []
    migrate.upgrade(engine, database)
    engine.dispose()


def test_a_store_of_a_newer_version_is_refused(tmp_path):
    MetadataStore.open(tmp_path).close()
    with closing(sqlite3.connect(tmp_path / "meta.sqlite")) as link:
        link.execute("UPDATE alembic_version SET version_num = 'meta_9999'")
        link.commit()
    with pytest.raises(StoreError, match="'meta_9999', which this version does not know"):
        MetadataStore.open(tmp_path)
    assert MetadataStore.holder(tmp_path) is None


def test_a_file_that_is_no_database_is_refused(tmp_path):
    (tmp_path / "meta.sqlite").write_text("not a database, but long enough to look at" * 10)
    with pytest.raises(StoreError, match="file is not a database"):
        MetadataStore.open(tmp_path)


def test_the_lock_file_says_who(store, tmp_path):
    assert json.loads((tmp_path / "data" / "meta.lock").read_text()) == {"pid": os.getpid(), "url": None}


def test_nobody_holds_a_store_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert MetadataStore.holder(tmp_path / "file") is None


def test_a_disk_without_room_for_the_lock_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(StoreError, match="No space left on device; see to the disk"):
        MetadataStore.open(tmp_path)
    monkeypatch.undo()
    MetadataStore.open(tmp_path).close()  # the refused one has left nothing locked


def test_what_people_write_about_runs_is_found_by_words(store):
    first, second = add_run(store, name="hppc"), add_run(store, bench="rig_2")
    before, after = store.runs.describe(first.id, {"label": "Cell 7", "notes": "50 % cold"})
    assert (before.label, after.label, after.notes, after.operator) == (None, "Cell 7", "50 % cold", None)
    found = lambda words: [run.id for run in store.runs.page(words=words)]  # noqa: E731
    assert found("cell HPPC") == found("50 %") == [first.id]
    assert found("rig_2") == [second.id] and found("rig%2") == []
    assert found("2026-01-01") == [second.id, first.id]
    with pytest.raises(NotFoundError):
        store.runs.describe("nothing", {"label": "x"})
