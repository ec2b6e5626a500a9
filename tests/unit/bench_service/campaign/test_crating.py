"""Runs on their way out: names, metadata files, and bundles that hold together."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench_service.api import samples
from bench_service.campaign.crating import crate_of
from bench_service.campaign.exporting import Export
from bench_service.exchange.naming import run_file_name
from bench_service.exchange.read import read_run_file
from bench_service.exchange.ro_crate import CrateFile, encode_crate
from bench_service.store.metadata import MetadataStore
from bench_service.store.reading import StreamData
from bench_service.store.records import ModelOrigin, RunIntent
from bench_service.streams import SAMPLES, STREAMS
from tests.unit.bench_service.api.route_rig import Part, client_of

ROOT = {"name": "n", "description": "d", "datePublished": "2026-01-02", "license": "l"}
N = 50


def columns() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    made = {column.name: np.zeros(N, column.numpy) for column in STREAMS[SAMPLES]}
    current_A = np.repeat(rng.normal(size=N // 5), 5)
    return made | {"time_s": 1.0 * np.arange(N), "current_A": current_A, "voltage_V": 3.7 + 0.03 * current_A}


@pytest.fixture
def store(tmp_path: Path) -> Iterator[MetadataStore]:
    with closing(MetadataStore.open(tmp_path / "data")) as opened:
        yield opened


def add_run(store: MetadataStore, cell_id: str | None, **more: Any) -> str:
    profile = store.profiles.add("p", np.array([0.0, 50.0]), np.array([1.0, 0.0]))
    intent = RunIntent(bench="b", profile_id=profile.id, dt_s=1.0, initial_soc=0.5, capacity_Ah=2.5, limits={},
                       code_version="1", cell_id=cell_id, **more)  # fmt: skip
    run = store.runs.add(intent)
    store.runs.start(run.id)
    return store.runs.end(run.id, "completed", None, n_samples=N, missed_ticks=0, sha256="ab").id


def filled(store: MetadataStore) -> Export:
    """A run of a cell, with a model made from it and another run, judged and diagnosed; and what is of others."""
    cell = store.cells.add(label="left", owner="Ana", metadata={"batch": "7b"})
    run_id, other = add_run(store, cell.id, name="first"), add_run(store, None)
    store.runs.describe(run_id, {"operator": "Bo"})
    origin = ModelOrigin(name="m", structure="auto", capacity_Ah=2.5, code_version="1",
                         train=store.runs.references([run_id, other]))  # fmt: skip
    model = store.models.add({"kind": "network"}, origin)
    store.models.add({"kind": "stranger"}, ModelOrigin(name="x", structure="auto", capacity_Ah=2.5, code_version="1"))
    store.comparisons.add(model.id, store.runs.references([run_id]), {"overall": {}}, code_version="1")
    store.comparisons.add(model.id, store.runs.references([other]), {"overall": {}}, code_version="1")
    store.diagnoses.add(model.id, store.runs.references([run_id]), {"verdict": "x"}, mode="change", code_version="1")
    store.events.add("info", "run_started", "it began", run_id=run_id)
    return Export(store, store.runs.get(run_id), "Lab A/b", "0.1")


def test_names_are_those_of_the_battery_data_format() -> None:
    assert run_file_name("Uni Köln", "LG-7", "2026-01-02T03:04", 7) == "Uni-K-ln__LG-7__20260102_007"
    assert run_file_name("__", "../x", "2026-01-02", 1) == "unnamed__x__20260102_001"


def test_a_runs_number_is_that_among_its_cells_of_the_day(store: MetadataStore) -> None:
    cell, other = store.cells.add(), store.cells.add()
    first, _, second, nobodys = (add_run(store, each) for each in (cell.id, other.id, cell.id, None))
    name = lambda run_id: Export(store, store.runs.get(run_id), "lab", "1").name  # noqa: E731
    store.runs.date(first, "2026-01-02T00:00:00Z", "2026-01-02T00:00:00Z", 1.0)
    store.runs.date(second, "2026-01-02T10:00:00Z", "2026-01-02T10:00:00Z", 1.0)
    assert (name(first), name(second)) == ("lab__C1__20260102_001", "lab__C1__20260102_002")
    assert name(nobodys) == f"run-{nobodys}"


def test_a_bundle_names_each_of_its_files_with_its_hash(store: MetadataStore) -> None:
    export = filled(store)
    content = crate_of(export, columns())
    assert crate_of(export, columns()) == content
    with zipfile.ZipFile(io.BytesIO(content)) as bundle:
        held = {name: bundle.read(name) for name in bundle.namelist()}
    document = json.loads(held.pop("ro-crate-metadata.json"))
    graph = {entity["@id"]: entity for entity in document["@graph"]}
    assert len(graph) == len(document["@graph"])
    assert graph["ro-crate-metadata.json"]["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    files = {key: entity for key, entity in graph.items() if entity["@type"] == "File"}
    assert set(files) == set(held) == {each["@id"] for each in graph["./"]["hasPart"]}
    for path, entity in files.items():
        assert entity["sha256"] == hashlib.sha256(held[path]).hexdigest()
        assert entity["contentSize"] == str(len(held[path]))
    folders = sorted({path.split("/")[0] for path in files})
    assert folders == [
        "cell.json",
        "comparisons",
        "data",
        "diagnoses",
        "events.json",
        "models",
        "profile.csv",
        "run.json",
    ]
    assert len(files) == 11  # data 3, about 4, model 2, comparison 1, diagnosis 1
    assert json.loads(held["events.json"])[-1]["text"] == "it began"


def test_all_that_a_bundle_points_to_is_in_it(store: MetadataStore) -> None:
    with zipfile.ZipFile(io.BytesIO(crate_of(filled(store), columns()))) as bundle:
        document = json.loads(bundle.read("ro-crate-metadata.json"))
    known = {entity["@id"] for entity in document["@graph"]}
    assert known >= {"#institution", "#cell", "#operator", "#run", "#bench"}

    def pointed(value: Any, top: bool = True) -> Iterator[str]:
        if isinstance(value, dict):
            if not top:
                assert set(value) == {"@id"}  # no entity inside of another
                yield value["@id"]
            for each in value.values() if top else ():
                yield from pointed(each, False)
        elif isinstance(value, list):
            for each in value:
                yield from pointed(each, False)

    found = {target for entity in document["@graph"] for target in pointed(entity)}
    assert {target for target in found if not target.startswith("http")} <= known
    made = next(entity for entity in document["@graph"] if entity["@id"].startswith("#made-"))
    assert "also made from run" in made["description"] and "sha256 ab" in made["description"]


def test_the_samples_of_a_bundle_come_back_as_they_were(store: MetadataStore, tmp_path: Path) -> None:
    with zipfile.ZipFile(io.BytesIO(crate_of(filled(store), columns()))) as bundle:
        data = [name for name in bundle.namelist() if name.endswith(".csv") and name.startswith("data/")]
        bundle.extractall(tmp_path)
    assert len(data) == 2
    for name in data:
        read = read_run_file(tmp_path / name).series
        np.testing.assert_array_equal(read.voltage_V, columns()["voltage_V"])
        np.testing.assert_array_equal(read.current_A, columns()["current_A"])


def test_the_metadata_file_keeps_to_the_keys_that_batterydf_takes(store: MetadataStore) -> None:
    document = filled(store).metadata()
    assert set(document) == {"bdf", "raw"} and document["bdf"] == {"source": "bench-service 0.1"}
    raw = document["raw"]
    assert (raw["institution"], raw["cell"]["owner"], raw["run"]["operator"]) == ("Lab A/b", "Ana", "Bo")
    assert raw["current_sign"] == "positive charges" and raw["samples_sha256"] == "ab"
    assert {"label": "Voltage / V", "quantity": "Voltage", "unit": "V", "meaning": "voltage at the cell"} in raw[
        "columns"
    ]


def test_over_rest_all_of_it_bears_the_name(store: MetadataStore) -> None:
    run = filled(store).run
    data = StreamData(STREAMS[SAMPLES], columns(), np.arange(N), ())
    client = client_of(
        samples.router,
        store=store,
        samples=Part(read=data),
        config=SimpleNamespace(institution="lab"),
        version="0.1",
        storage=Part(note_damage=None),
    )
    day = str(run.started_utc)[:10].replace("-", "")
    for name, suffix in (("ro-crate", ".crate.zip"), ("bdf", ".bdf.csv"), ("bdf-parquet-0.1.0", ".bdf.parquet")):
        answer = client.get(f"/runs/{run.id}/export?format={name}&damaged=include")
        assert answer.status_code in (200, 206, 409), answer.text
        if answer.status_code == 200:
            assert answer.headers["content-disposition"] == f'attachment; filename="lab__C1__{day}_001{suffix}"'
    told = client.get(f"/runs/{run.id}/metadata")
    assert told.headers["content-disposition"].endswith('_001.bdf.metadata.json"') and told.json()["raw"]["cell"]


def test_a_bundle_says_what_the_specification_asks_for() -> None:
    twice = [CrateFile("a", b"", "text/plain"), CrateFile("a", b"", "text/plain")]
    with pytest.raises(ValueError, match="stands twice"):
        encode_crate(ROOT, twice, [])
    with pytest.raises(ValueError, match="must say its license"):
        encode_crate({key: value for key, value in ROOT.items() if key != "license"}, [], [])
