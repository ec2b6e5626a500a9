"""Each long list page by page: every record once, whatever comes or goes between two pages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sqlalchemy import delete

from bench_service.api import (
    campaigns,
    cells,
    comparisons,
    diagnoses,
    events,
    models,
    profiles,
    protocols,
    runs,
)
from bench_service.store import schema
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import ModelOrigin, RunIntent
from tests.unit.bench_service.api.route_rig import client_of


def _run(store: MetadataStore) -> str:
    profile = store.profiles.add("p", np.array([0.0, 50.0]), np.array([1.0, 0.0]))
    intent = RunIntent(bench="b", profile_id=profile.id, dt_s=1.0, initial_soc=0.5, capacity_Ah=2.5, limits={},
                       code_version="1")  # fmt: skip
    return store.runs.add(intent).id


def _model(store: MetadataStore) -> str:
    return store.models.add({}, ModelOrigin(name="m", structure="auto", capacity_Ah=2.5, code_version="1")).id


def _campaign(store: MetadataStore) -> str:
    return store.campaigns.add(name="c", bench="b", stage="design", stages=(), request={}, code_version="1").id


# List -> router, table, and how one record comes into it.
LISTS: dict[str, tuple[Any, str, Callable[[MetadataStore], Any]]] = {
    "runs": (runs.router, "run", _run),
    "profiles": (profiles.router, "profile", lambda store: store.profiles.add("p", np.arange(2.0), np.zeros(2)).id),
    "models": (models.router, "model", _model),
    "comparisons": (
        comparisons.router,
        "comparison",
        lambda store: store.comparisons.add(_model(store), [], {}, code_version="1").id,
    ),
    "diagnoses": (
        diagnoses.router,
        "diagnosis",
        lambda store: store.diagnoses.add(_model(store), [], {}, mode="change", code_version="1").id,
    ),
    "campaigns": (campaigns.router, "campaign", _campaign),
    "protocols": (protocols.router, "protocol", lambda store: store.protocols.add("p", 1, {}).id),
    "events": (events.router, "event", lambda store: store.events.add("info", "note", "text").id),
    "cells": (cells.router, "cell", lambda store: store.cells.add().id),
}


@pytest.fixture
def store(tmp_path: Path) -> Iterator[MetadataStore]:
    with closing(MetadataStore.open(tmp_path / "data")) as opened:
        yield opened


def served(store: MetadataStore, name: str) -> Any:
    async def listed(limit: int, offset: int, after: int | None) -> list[Any]:
        return store.campaigns.page(limit, offset, after)

    told = SimpleNamespace(all_to_json=lambda found: [{"id": cell.id} for cell in found])
    return client_of(LISTS[name][0], store=store, cells=told, campaigns=SimpleNamespace(list=listed))


def page(client: Any, name: str, **asked: Any) -> tuple[list[Any], int | None]:
    answer = client.get(f"/{name}", params={key: value for key, value in asked.items() if value is not None}).json()
    return [each["id"] for each in answer[name]], answer["next_cursor"]


@pytest.mark.parametrize("name", LISTS)
def test_every_record_comes_once_whatever_comes_or_goes(name: str, store: MetadataStore) -> None:
    _, table, add = LISTS[name]
    there = [add(store) for _ in range(7)]
    client = served(store, name)
    first, cursor = page(client, name, limit=3)
    assert first == there[:3:-1] and page(client, name)[1] is None
    add(store)
    rows = schema.META.tables[table]
    with store._file.write() as link:  # the very record at which the page ended, and one that is still to come
        link.execute(delete(rows).where(rows.c.id.in_([there[4], there[2]])))
    second, cursor = page(client, name, limit=2, cursor=cursor)
    assert second == [there[3], there[1]] and cursor is not None
    assert page(client, name, limit=2, cursor=cursor) == ([there[0]], None)
    assert page(client, name, limit=2, offset=1)[0] == [there[6], there[5]]  # as before


@pytest.mark.parametrize("name", LISTS)
@pytest.mark.parametrize("query", ["cursor=x", "cursor=-1", "cursor=1.5", f"cursor={2**63}", "cursor=3&offset=2"])
def test_a_bad_cursor_is_one_clear_line(name: str, query: str, store: MetadataStore) -> None:
    answer = served(store, name).get(f"/{name}?{query}", headers={"Accept": "application/problem+json"})
    assert answer.status_code == 422 and answer.headers["content-type"] == "application/problem+json"
    assert "cursor" in str(answer.json()["where"]) and "\n" not in answer.json()["detail"]
