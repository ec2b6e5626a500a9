"""Cells: what each is, whose it is, where it stands, and what belongs to it."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import AfterValidator, Field, JsonValue

from bench_service.api.answers import asked, bench, paged, record
from bench_service.api.dependencies import Answer, PageOf, PathId, ServicesOf
from bench_service.api.strict import Body, Id, Name, Positive, StrictRoute
from bench_service.errors import BadRequestError

router = APIRouter(tags=["cells"], route_class=StrictRoute)

_MOST_ENTRIES = 100


def _flat(told: dict[str, Any]) -> dict[str, Any]:
    for name, value in told.items():
        if not isinstance(value, str | bool | int | float) or len(str(value)) > 2000:
            raise ValueError(f"{name!r} must be a text of at most 2000 characters, a number, true or false")
    return told


CellId = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,31}$")]
Metadata = Annotated[dict[Name, JsonValue], Field(max_length=_MOST_ENTRIES), AfterValidator(_flat)]


class ChangeBody(Body):
    """What a cell is and whose; ``type`` has the keys of a cell-type file."""

    label: Name | None = None
    owner: Name | None = None
    type: dict[str, Any] | None = None
    capacity_Ah: Positive | None = None
    metadata: Metadata = {}


class CellBody(ChangeBody):
    """A cell to take in; ``like`` names one of the same type, without an ``id`` the next free one is given."""

    id: CellId | None = None
    like: Id | None = None


class PlaceBody(Body):
    """The cell that is on a bench; null: none that has a name."""

    cell_id: Id | None


@router.post(
    "/cells",
    status_code=201,
    openapi_extra=record("Cell")
    | asked({"label": "left", "owner": "Ana", "capacity_Ah": 2.48, "metadata": {"batch": "7b", "shelf": 3}}),
)
async def add_cell(body: CellBody, services: ServicesOf) -> Answer:
    """Take a cell in."""
    if body.like is not None and body.type is not None:
        raise BadRequestError("a cell has the type of another one, or its own", ("like",), remedy="give one of both")
    return await services.cells.add(body.model_dump(exclude={"like"}), body.like)


@router.get("/cells", openapi_extra=paged("cells", "Cell"))
def list_cells(
    services: ServicesOf,
    page: PageOf,
    q: Annotated[str | None, Query(max_length=200)] = None,
    retired: bool = False,
) -> Answer:
    """List cells, newest first; with ``q`` those in whose id, label, owner, type or metadata each word is."""
    answer = page.answer(
        services, ("cells", "cell"), services.store.cells.page(q, retired=retired, **page.asked), lambda cell: cell
    )
    return answer | {"cells": services.cells.all_to_json(answer["cells"])}


@router.get("/cells/{cell_id}", openapi_extra=record("Cell"))
def get_cell(cell_id: PathId, services: ServicesOf) -> Answer:
    """Give one cell: how much belongs to it, on which bench it is, and on which it was."""
    cell = services.store.cells.get(cell_id)
    places = [{"bench": place.bench, "since_utc": place.since_utc} for place in services.store.cells.places(cell.id)]
    return services.cells.to_json(cell) | {"places": places}


@router.patch("/cells/{cell_id}", openapi_extra=record("Cell") | asked({"label": "left, aged", "capacity_Ah": 2.31}))
async def change_cell(cell_id: PathId, body: ChangeBody, services: ServicesOf) -> Answer:
    """Write down what is given; what is left out stays, null takes it away. Kept as an event.

    A cell that is on a bench changes its type or capacity only while nothing runs there.
    """
    return await services.cells.change(cell_id, body.model_dump(exclude_unset=True))


@router.post("/cells/{cell_id}/retire", openapi_extra=record("Cell"))
async def retire_cell(cell_id: PathId, services: ServicesOf) -> Answer:
    """Note that a cell is not used any more; all that belongs to it stays. 409 while it is on a bench."""
    return await services.cells.retire(cell_id)


@router.post("/cells/{cell_id}/reuse", openapi_extra=record("Cell"))
async def reuse_cell(cell_id: PathId, services: ServicesOf) -> Answer:
    """Take a retired cell into use again."""
    return await services.cells.retire(cell_id, used_again=True)


@router.get("/cells/{cell_id}/events", openapi_extra=paged("events", "Event"))
def list_cell_events(cell_id: PathId, services: ServicesOf, page: PageOf) -> Answer:
    """List what has happened to a cell: taken in, changed, put on benches, given runs."""
    cell = services.store.cells.get(cell_id)
    found = services.store.events.page(cell_id=cell.id, **page.asked)
    return page.answer(services, ("events", "event"), found, asdict)


@router.put("/benches/{name}/cell", openapi_extra=bench() | asked({"cell_id": "C1"}))
async def put_cell(name: PathId, body: PlaceBody, services: ServicesOf) -> Answer:
    """Say which cell is on a bench: the tighter limits of both hold, its capacity counts, runs belong to it.

    Answers with the bench. 409 while a run or a campaign is there, where the cell is retired or on another bench.
    """
    return await asyncio.shield(services.cells.put(name, body.cell_id))
