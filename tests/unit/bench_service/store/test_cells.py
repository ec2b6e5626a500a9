"""Cells in the store: their ids, what they are found by, where they stand, and what belongs to them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import create_engine

from bench_service.errors import ConflictError, NotFoundError
from bench_service.store import schema
from bench_service.store.metadata import MetadataStore
from bench_service.store.migrate import directory
from bench_service.store.records import ModelOrigin, RunIntent

TYPE = {"maker": "Maker", "model": "M50", "chemistry": "NMC"}


@pytest.fixture
def store(tmp_path: Path) -> Iterator[MetadataStore]:
    with closing(MetadataStore.open(tmp_path)) as opened:
        yield opened


def add_run(store: MetadataStore, cell_id: str | None = None, bench: str = "b") -> str:
    intent = RunIntent(
        bench=bench,
        profile_id=None,
        dt_s=1.0,
        initial_soc=0.5,
        capacity_Ah=2.5,
        limits={},
        code_version="1",
        cell_id=cell_id,
    )
    return store.runs.end(store.runs.add(intent).id, "completed", None, n_samples=2, sha256="ab").id


def add_model(store: MetadataStore, *train: str) -> str:
    origin = ModelOrigin(
        name="m", structure="minimal", capacity_Ah=2.5, code_version="1", train=store.runs.references(train)
    )
    return store.models.add({"n": 1}, origin).id


def test_ids_are_short_and_may_be_typed_in_any_letters(store: MetadataStore) -> None:
    store.cells.add("c2", label="chosen")
    assert [store.cells.add().id for _ in range(3)] == ["C3", "C4", "C5"]
    assert store.cells.get("C2").label == "chosen" and store.cells.get("c4").id == "C4"
    with pytest.raises(ConflictError, match="there is a cell C2 already"):
        store.cells.add("C2")
    with pytest.raises(NotFoundError, match="unknown cell 'C9'"):
        store.cells.get("C9")


def test_a_cell_comes_back_as_it_was_and_as_it_was_changed(tmp_path: Path) -> None:
    with closing(MetadataStore.open(tmp_path)) as store:
        kept = store.cells.add(label="left", owner="Ana", type=TYPE, metadata={"batch": "7b", "mass_g": 68.2})
        before, after = store.cells.change("c1", {"label": None, "capacity_Ah": 4.8})
        assert before == kept and (after.label, after.capacity_Ah, after.type) == (None, 4.8, TYPE)
    with closing(MetadataStore.open(tmp_path)) as store:
        assert store.cells.get("C1") == after


def test_cells_are_found_by_words_page_by_page(store: MetadataStore) -> None:
    for k in range(5):
        store.cells.add(owner="Ana" if k % 2 else "Bo", type=TYPE if k < 4 else None, metadata={"batch": f"B_{k}"})
    found = lambda words: [cell.id for cell in store.cells.page(words)]  # noqa: E731
    assert found("ana") == ["C4", "C2"] and found("m50 BO") == ["C3", "C1"]
    assert found("b_3") == ["C4"] and found("b%3") == [] and found("batch nmc") == ["C4", "C3", "C2", "C1"]
    first = store.cells.page(limit=2)
    store.cells.add()  # one that comes in meanwhile moves no other
    second = store.cells.page(limit=4, after=store.place("cell", first[-1].id))
    assert [cell.id for cell in (*first, *second)] == ["C5", "C4", "C3", "C2", "C1"]


def test_a_cell_stands_on_one_bench_at_a_time(store: MetadataStore) -> None:
    for _ in range(2):
        store.cells.add()
    assert store.cells.place("left") is None
    place = store.cells.put("left", "c1")
    assert store.cells.place("left") == place and place.cell_id == "C1"
    with pytest.raises(ConflictError, match="cell C1 is on bench 'left'; take it off there"):
        store.cells.put("right", "C1")
    with pytest.raises(ConflictError, match="take it off first"):
        store.cells.retire("C1")
    store.cells.put("left", "C2")
    assert store.cells.bench_of("C1") is None and store.cells.bench_of("C2") == "left"
    store.cells.put("right", "C1")
    store.cells.put("left", None)
    assert store.cells.bench_of("C2") is None and [each.bench for each in store.cells.places("C1")] == ["right", "left"]


def test_a_retired_cell_is_not_put_on_a_bench_and_stays_readable(store: MetadataStore) -> None:
    store.cells.add()
    store.cells.add()
    retired = store.cells.retire("C1")
    assert retired.retired_utc is not None and store.cells.retire("C1") == retired
    with pytest.raises(ConflictError, match="cell C1 is retired"):
        store.cells.put("left", "C1")
    assert [cell.id for cell in store.cells.page(retired=False)] == ["C2"]
    assert len(store.cells.page()) == 2
    assert store.cells.retire("C1", used_again=True).retired_utc is None


def test_what_is_made_from_runs_belongs_to_their_cell(store: MetadataStore) -> None:
    for _ in range(2):
        store.cells.add()
    one, other, nobodys = add_run(store, "C1"), add_run(store, "C2"), add_run(store)
    model = add_model(store, one)
    of_one, of_both = store.runs.references([one]), store.runs.references([one, other])
    assert store.models.get(model).cell_id == "C1"
    assert store.comparisons.add(model, of_one, {}, code_version="1").cell_id == "C1"
    assert store.comparisons.add(model, of_both, {}, code_version="1").cell_id is None
    diagnosis = store.diagnoses.add(model, of_one, {}, mode="change", code_version="1").id
    assert [run.id for run in store.runs.page(cell_id="C1")] == [one]
    assert [each.id for each in store.models.page(cell_id="C1")] == [model] and store.models.page(cell_id="C2") == []
    assert [each.id for each in store.diagnoses.page(cell_id="C1")] == [diagnosis]
    assert store.cells.counts(["C1", "C2"]) == {
        "C1": {"n_run": 1, "n_model": 1, "n_comparison": 1, "n_diagnosis": 1},
        "C2": {"n_run": 1, "n_model": 0, "n_comparison": 0, "n_diagnosis": 0},
    }
    assert add_model(store, nobodys) and store.models.page()[0].cell_id is None


def test_a_run_that_is_given_to_a_cell_takes_along_what_was_made_from_it(store: MetadataStore) -> None:
    for _ in range(2):
        store.cells.add()
    first, second = add_run(store), add_run(store)
    model = add_model(store, first, second)
    store.cells.give_run(first, "c1")
    assert store.runs.get(first).cell_id == "C1" and store.models.get(model).cell_id is None
    store.cells.give_run(second, "C1")
    assert store.models.get(model).cell_id == "C1"
    store.cells.give_run(second, None)
    assert store.models.get(model).cell_id is None
    with pytest.raises(NotFoundError):
        store.cells.give_run("nothing", "C1")
    with pytest.raises(NotFoundError):
        store.cells.give_run(first, "C7")


def test_a_store_from_before_there_were_cells_opens_with_all_that_is_in_it(tmp_path: Path) -> None:
    with closing(MetadataStore.open(tmp_path)) as store:
        run = add_run(store)
        model = add_model(store, run)
        store.events.add("info", "old", "as it was", run_id=run)
    engine = create_engine(f"sqlite:///{tmp_path / 'meta.sqlite'}")
    with engine.begin() as link:
        config = Config()
        config.set_main_option("script_location", str(directory("meta").parent))
        config.set_main_option("path_separator", "newline")
        config.set_main_option("version_locations", str(directory("meta")))
        config.attributes |= {"connection": link, "metadata": schema.META}
        command.downgrade(config, "meta_0006")
    engine.dispose()
    with closing(MetadataStore.open(tmp_path)) as store:
        assert store.runs.get(run).cell_id is None and store.models.get(model).cell_id is None
        assert [event.text for event in store.events.page(run)] == ["as it was"]
        cell = store.cells.add()
        store.cells.give_run(run, cell.id)
        assert store.models.get(model).cell_id == store.runs.get(run).cell_id == "C1"


def test_events_of_a_cell_are_its_own(store: MetadataStore) -> None:
    store.cells.add()
    kept = store.events.add("info", "cell_added", "cell C1 is taken in", cell_id="C1")
    store.events.add("info", "x", "of nobody")
    assert store.events.page(cell_id="C1") == [kept] and kept.cell_id == "C1"
