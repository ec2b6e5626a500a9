"""Diagnoses in the store, and the family of a model."""

from contextlib import closing

import numpy as np
import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, create_engine, inspect

from bench_service.errors import NotFoundError
from bench_service.store import schema
from bench_service.store.metadata import MetadataStore
from bench_service.store.migrate import directory
from bench_service.store.records import ModelOrigin, RunIntent

RESULT = {"verdict": "missing", "findings": [{"effect": "hysteresis", "rank": 1}]}


@pytest.fixture
def store(tmp_path):
    with closing(MetadataStore.open(tmp_path)) as opened:
        yield opened


def add_model(store, name, parent_id=None):
    record = store.models.add(
        {"n": name}, ModelOrigin(name=name, structure="minimal", capacity_Ah=2.5, code_version="1", parent_id=parent_id)
    )
    return record.id


def add_run(store):
    profile = store.profiles.add("p", np.array([0.0, 1.0]), np.array([1.0, 0.0]))
    run = store.runs.add(
        RunIntent(
            bench="b", profile_id=profile.id, dt_s=1.0, initial_soc=0.5, capacity_Ah=2.5, limits={}, code_version="1"
        )
    )
    return store.runs.end(run.id, "completed", None, n_samples=2, sha256="ab").id


def test_a_diagnosis_comes_back_as_it_was_and_outlives_the_store(tmp_path):
    with closing(MetadataStore.open(tmp_path)) as store:
        model_id, other = add_model(store, "m"), add_model(store, "other")
        runs, train = store.runs.references([add_run(store)]), store.runs.references([add_run(store)])
        kept = store.diagnoses.add(
            model_id, runs, RESULT, mode="change", train=train, initial_soc=0.4, code_version="1"
        )
        newer = store.diagnoses.add(other, runs, RESULT, mode="structure", code_version="1")
    with closing(MetadataStore.open(tmp_path)) as store:
        assert store.diagnoses.get(kept.id) == kept
        assert kept.run_ids == (runs[0].run_id,) and kept.train == train and kept.runs[0].sha256 == "ab"
        assert store.diagnoses.page() == [newer, kept]
        assert store.diagnoses.page(model_id) == [kept] and store.diagnoses.page(limit=1, offset=1) == [kept]


def test_an_unknown_diagnosis_is_named(store):
    with pytest.raises(NotFoundError, match="unknown diagnosis 'nope'"):
        store.diagnoses.get("nope")
    with pytest.raises(NotFoundError, match="unknown model 'nope'"):
        store.models.family("nope")


def test_a_family_is_everything_from_the_first_version_on(store):
    first = add_model(store, "first")
    add_model(store, "stranger")
    left, right = add_model(store, "left", first), add_model(store, "right", first)
    grandchild = add_model(store, "grandchild", left)
    for member in (first, left, right, grandchild):
        assert [each.id for each in store.models.family(member)] == [first, left, right, grandchild]


def downgrade(link: Connection, revision: str) -> None:
    config = Config()
    config.set_main_option("script_location", str(directory("meta").parent))
    config.set_main_option("path_separator", "newline")
    config.set_main_option("version_locations", str(directory("meta")))
    config.attributes |= {"connection": link, "metadata": schema.META}
    command.downgrade(config, revision)


def test_a_file_of_the_earlier_schema_gets_the_table(tmp_path):
    with closing(MetadataStore.open(tmp_path)) as store:
        model_id = add_model(store, "old")
    engine = create_engine(f"sqlite:///{tmp_path / 'meta.sqlite'}")
    with engine.begin() as link:  # as the first revision left it
        downgrade(link, "meta_0003")
        link.exec_driver_sql("DROP TABLE diagnosis")
        link.exec_driver_sql("DROP INDEX ix_model_parent_id")
        for table in ("profile", "campaign", "model", "run", "comparison"):
            link.exec_driver_sql(f"DROP INDEX ix_{table}_number")
            link.exec_driver_sql(f"ALTER TABLE {table} DROP COLUMN number")
        link.exec_driver_sql("ALTER TABLE campaign DROP COLUMN done")
        for column in ("damage", "elapsed_s", "continues", "repaired_utc", "removed_utc"):
            link.exec_driver_sql(f"ALTER TABLE run DROP COLUMN {column}")
        link.exec_driver_sql("UPDATE alembic_version SET version_num = 'meta_0001'")
    engine.dispose()
    with closing(MetadataStore.open(tmp_path)) as store:
        assert [each.id for each in store.models.page()] == [model_id]
        assert store.diagnoses.page() == []
    engine = create_engine(f"sqlite:///{tmp_path / 'meta.sqlite'}")
    assert "ix_model_parent_id" in {each["name"] for each in inspect(engine).get_indexes("model")}
    engine.dispose()
