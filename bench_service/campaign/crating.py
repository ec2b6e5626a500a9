"""A run with all that was made from it as an RO-Crate: samples, cell, models, comparisons, diagnoses, hashes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from bench_service.campaign.crate_entities import institution_entities, made_entities, run_entities
from bench_service.campaign.exporting import Export
from bench_service.exchange.bdf_metadata import SUFFIX, encode_metadata
from bench_service.exchange.delimited import encode_csv
from bench_service.exchange.format import Array
from bench_service.exchange.ro_crate import CrateFile, encode_crate, json_file
from bench_service.exchange.write import encode_run, export_formats
from bench_service.store.diagnoses import DiagnosisRecord
from bench_service.store.records import ComparisonRecord, ModelRecord

CRATE = "ro-crate"
TITLE = "RO-Crate bundle of run, models, comparisons and diagnoses, zip"
_MOST = 10_000
_PLAYED = ("profile.csv", "protocol.json")


def crate_of(export: Export, columns: Mapping[str, Array]) -> bytes:
    """Return a run and all that was made from it as an RO-Crate; `columns` are its samples. Reads the store."""
    data = [_data(export, "bdf", columns), _metadata_file(export), _data(export, "csv", columns)]
    about, models = _about(export), _models(export)
    paths = {model.id: f"models/{model.id[:8]}.json" for model in models}
    made = [_model_file(export, model, paths[model.id]) for model in models]
    results = [each for model in models for each in _results(export, model, [paths[model.id], data[-1].path])]
    entities = [
        *institution_entities(export),
        *run_entities(export, [each.path for each in data], [each.path for each in about if each.path in _PLAYED]),
        *made_entities(export.run.id, models, paths, data[-1].path),
    ]
    return encode_crate(_root(export), [*data, *about, *made, *results], entities)


def _root(export: Export) -> dict[str, Any]:
    run = export.run
    cell = "" if run.cell_id is None else f" of cell {run.cell_id}"
    told = "samples, models made from them, comparisons and diagnoses. Positive current charges."
    return {
        "name": f"{export.called}{cell}",
        "description": f"Battery measurement on bench {run.bench}{cell}: {told}",
        "datePublished": (run.ended_utc or run.created_utc)[:10],
        "license": {"@id": "#license"},
        "author": {"@id": "#institution"},
        "publisher": {"@id": "#institution"},
        "identifier": run.id,
        "mentions": [{"@id": "#run"}],
    } | ({} if run.cell_id is None else {"about": {"@id": "#cell"}})


def _data(export: Export, format_name: str, columns: Mapping[str, Array]) -> CrateFile:
    chosen = export_formats()[format_name]
    content = encode_run(columns, format_name, export.started_unix_s)
    told = {"name": f"samples of {export.called}", "description": chosen.title}
    return CrateFile(f"data/{export.name}{chosen.suffix}", content, chosen.media_type, told)


def _metadata_file(export: Export) -> CrateFile:
    told = {"name": f"metadata of {export.called}", "about": {"@id": f"data/{export.name}.bdf.csv"}}
    return CrateFile(f"data/{export.name}{SUFFIX}", encode_metadata(export.metadata()), "application/json", told)


def _about(export: Export) -> list[CrateFile]:
    """What was decided before it, what it was played on, and what happened."""
    run, cell, store = export.run, export.cell, export.store
    found = [json_file("run.json", asdict(run), name=f"record of {export.called}")]
    if cell is not None:
        found.append(json_file("cell.json", asdict(cell), name=f"cell {cell.called}"))
    if run.profile_id is not None:
        time_s, current_A = store.profiles.points(run.profile_id)
        content = encode_csv({"time_s": time_s, "current_A": current_A})
        found.append(CrateFile("profile.csv", content, "text/csv", {"name": "profile that was played"}))
    if run.protocol_id is not None:
        document = store.protocols.document(run.protocol_id)
        found.append(json_file("protocol.json", document, name="protocol that was played"))
    events = [asdict(event) for event in reversed(store.events.page(run.id, _MOST))]
    return [*found, json_file("events.json", events, name="what happened in the run")]


def _models(export: Export) -> list[ModelRecord]:
    """Models that were made from it, judged on it, or watched it; the oldest first."""
    run, store = export.run, export.store
    looked = (*store.comparisons.page(None, _MOST), *store.diagnoses.page(None, _MOST))
    named = {run.model_id} | {each.model_id for each in looked if run.id in each.run_ids}
    used = lambda model: {each.run_id for each in (*model.train, *model.validate)}  # noqa: E731
    return [model for model in reversed(store.models.page(_MOST)) if model.id in named or run.id in used(model)]


def _model_file(export: Export, model: ModelRecord, path: str) -> CrateFile:
    told = {"name": model.name, "description": f"local model network ({model.structure}), MODEL.json"}
    return json_file(path, export.store.models.document(model.id), **told)


def _results(export: Export, model: ModelRecord, based_on: Sequence[str]) -> list[CrateFile]:
    """Records of a model, and of its comparisons and diagnoses that looked at the run."""
    store, based = export.store, [{"@id": path} for path in based_on]
    found = [json_file(f"models/{model.id[:8]}.record.json", asdict(model), name=f"record of {model.name}")]
    comparisons: list[ComparisonRecord | DiagnosisRecord] = [*store.comparisons.page(model.id, _MOST)]
    diagnoses: list[ComparisonRecord | DiagnosisRecord] = [*store.diagnoses.page(model.id, _MOST)]
    for folder, kind, records in (("comparisons", "comparison", comparisons), ("diagnoses", "diagnosis", diagnoses)):
        for each in reversed(records):
            if export.run.id in each.run_ids:
                told = {"name": f"{kind} with {model.name}", "isBasedOn": based}
                found.append(json_file(f"{folder}/{each.id[:8]}.json", asdict(each), **told))
    return found
