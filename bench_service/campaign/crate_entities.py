"""What the files of a run's crate are and come from: institution, cell, bench, program, and the actions of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench_service.campaign.exporting import Export
from bench_service.exchange.ro_crate import Entity
from bench_service.store.cells import CellRecord
from bench_service.store.records import ModelRecord

_LICENSE = "None is given: ask the institution."


def institution_entities(export: Export) -> list[Entity]:
    """Return whose it is, what it was played with, and on which cell."""
    run, cell = export.run, export.cell
    program = {"@id": "#bench-service", "@type": "SoftwareApplication", "name": "bench-service"}
    found: list[Entity] = [
        {"@id": "#institution", "@type": "Organization", "name": export.institution},
        {"@id": "#license", "@type": "CreativeWork", "name": "no licence", "description": _LICENSE},
        program | {"version": run.code_version},
        {"@id": "#bench", "@type": "Thing", "name": f"bench {run.bench}"},
    ]
    if run.operator:
        found.append({"@id": "#operator", "@type": "Person", "name": run.operator})
    return found if cell is None else [*found, *_cell(cell)]


def run_entities(export: Export, data: Sequence[str], played: Sequence[str]) -> list[Entity]:
    """Return the run as the action that has made its data; paths of files."""
    run = export.run
    state = "Completed" if run.state == "completed" else "Failed"
    action: Entity = {
        "@id": "#run",
        "@type": "CreateAction",
        "name": export.called,
        "instrument": [{"@id": "#bench-service"}, {"@id": "#bench"}],
        "startTime": run.started_utc or run.created_utc,
        "endTime": run.ended_utc or run.created_utc,
        "object": [{"@id": path} for path in (*played, *(["#cell"] if run.cell_id else []))],
        "result": [{"@id": path} for path in data],
        "actionStatus": {"@id": f"http://schema.org/{state}ActionStatus"},
    }
    return [action | ({"agent": {"@id": "#operator"}} if run.operator else {})]


def made_entities(run_id: str, models: Sequence[ModelRecord], paths: Mapping[str, str], data_path: str) -> list[Entity]:
    """Return the identifications that have made the models; runs of other crates are named by id and hash."""
    found: list[Entity] = []
    for model in models:
        others = [f"run {each.run_id} (sha256 {each.sha256})" for each in model.train if each.run_id != run_id]
        action: Entity = {
            "@id": f"#made-{model.id[:8]}",
            "@type": "CreateAction",
            "name": f"identification of {model.name}",
            "instrument": {"@id": "#bench-service"},
            "endTime": model.created_utc,
            "object": [{"@id": data_path}] if run_id in {each.run_id for each in model.train} else [],
            "result": {"@id": paths[model.id]},
        }
        found.append(action | ({"description": f"also made from {', '.join(others)}"} if others else {}))
    return found


def _cell(cell: CellRecord) -> list[Entity]:
    kind = cell.type or {}
    entity: Entity = {"@id": "#cell", "@type": "IndividualProduct", "name": f"cell {cell.called}"}
    entity["identifier"] = cell.id
    if kind:
        entity |= {"manufacturer": kind["maker"], "model": kind["model"], "category": kind["chemistry"]}
    # The specification wants no entity inside of another.
    told: list[tuple[str, Any]] = [*cell.metadata.items()]
    properties = [
        {"@id": f"#cell-{k}", "@type": "PropertyValue", "name": name, "value": value}
        for k, (name, value) in enumerate(told, 1)
    ]
    if properties:
        entity["additionalProperty"] = [{"@id": each["@id"]} for each in properties]
    return [entity, *properties]
