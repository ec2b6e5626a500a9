"""Imports: files of any cycler's program, uploaded piece by piece, looked at, corrected, stored as runs."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated, Any, ClassVar, Literal

from fastapi import APIRouter, Query, Request
from pydantic import Field

from bench_service.api.answers import asked, job, keyed, listed, shown
from bench_service.api.dependencies import Answer, PathId, ServicesOf
from bench_service.api.strict import Body, Id, Name, Positive, Soc, StrictRoute
from bench_service.campaign.importing import MOST_BYTES

router = APIRouter(prefix="/imports", tags=["imports"], route_class=StrictRoute)
mapping_router = APIRouter(prefix="/mappings", tags=["imports"], route_class=StrictRoute)
_Short = Annotated[str, Field(max_length=200)]


class ImportBody(Body):
    """A file that is to come."""

    name: Name


class ColumnBody(Body):
    """Which column holds something; an empty name: none does."""

    column: _Short
    unit: _Short | None = None


class ChoicesBody(Body):
    """What a person settles; everything else is guessed."""

    format: _Short | None = None
    mapping: _Short | None = None
    columns: dict[_Short, ColumnBody] = {}
    current_sign: Literal["charge-positive", "discharge-positive"] | None = None
    date_order: Literal["day-first", "month-first"] | None = None
    time_zone: _Short | None = None
    cell: _Short | None = None
    leave_out: bool = False


class StoreBody(Body):
    """A run to make of a file."""

    capacity_Ah: Positive
    initial_soc: Soc
    name: Name | None = None
    cell_id: Id | None = None
    choices: ChoicesBody = ChoicesBody()


class _UploadRoute(StrictRoute):
    """Route whose body is a file, which goes to the disk as it comes."""

    max_bytes: ClassVar[int] = MOST_BYTES


upload_router = APIRouter(prefix="/imports", tags=["imports"], route_class=_UploadRoute)
_FILE = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}


@router.post(
    "",
    status_code=201,
    openapi_extra=keyed("id", "name", "n_bytes")
    | asked({"name": "cycler-export.csv"})
    | shown({"id": "dc761ca4", "name": "cycler-export.csv", "n_bytes": 0}),
)
async def add_import(body: ImportBody, services: ServicesOf) -> Answer:
    """Begin an upload of a file with this name."""
    return await asyncio.to_thread(services.importing.add, body.name)


@router.get(
    "/{import_id}",
    openapi_extra=keyed("id", "name", "n_bytes")
    | shown({"id": "dc761ca4", "name": "cycler-export.csv", "n_bytes": 43}),
)
def get_import(import_id: PathId, services: ServicesOf) -> Answer:
    """Tell how many bytes of an upload are there: a broken one goes on from there."""
    return services.importing.get(import_id)


@upload_router.put(
    "/{import_id}/content",
    openapi_extra=_FILE
    | keyed("id", "name", "n_bytes")
    | shown({"id": "dc761ca4", "name": "cycler-export.csv", "n_bytes": 43}),
)
async def put_content(
    import_id: PathId, request: Request, services: ServicesOf, offset: Annotated[int, Query(ge=0)] = 0
) -> Answer:
    """Add the body to an upload, from `offset` on."""
    return await services.importing.append(import_id, offset, request.stream())


@router.post(
    "/{import_id}/look",
    status_code=202,
    openapi_extra=job() | asked({"current_sign": "discharge-positive", "time_zone": "Europe/Berlin"}),
)
async def look(import_id: PathId, body: ChoicesBody, services: ServicesOf) -> Answer:
    """Look at an upload: a job, whose result says what each column is taken for and why, and what is unclear."""
    return asdict(services.importing.look(import_id, _plain(body)))


@router.post(
    "/{import_id}/run",
    status_code=202,
    openapi_extra=job() | asked({"capacity_Ah": 2.5, "initial_soc": 0.5, "name": "first day", "cell_id": "C1"}),
)
async def store(import_id: PathId, body: StoreBody, services: ServicesOf) -> Answer:
    """Store an upload as a run: a job, whose result has its id in ``run``."""
    told = body.model_dump(include={"capacity_Ah", "initial_soc", "name", "cell_id"})
    return asdict(services.importing.store(import_id, _plain(body.choices), told))


@router.delete("/{import_id}", openapi_extra=keyed("id", "state") | shown({"id": "dc761ca4", "state": "dropped"}))
async def drop_import(import_id: PathId, services: ServicesOf) -> Answer:
    """Forget an upload."""
    await asyncio.to_thread(services.importing.drop, import_id)
    return {"id": import_id, "state": "dropped"}


@mapping_router.get("", openapi_extra=listed("mappings") | shown({"mappings": [{"name": "ours"}]}))
def list_mappings(services: ServicesOf) -> Answer:
    """List the mappings that are remembered."""
    return {"mappings": services.importing.mappings()}


@mapping_router.post("", status_code=201, openapi_extra=keyed("name") | shown({"name": "ours"}))
def add_mapping(body: dict[str, Any], services: ServicesOf) -> Answer:
    """Remember a mapping by the name in it, in place of an older one."""
    return services.importing.save_mapping(body)


def _plain(body: ChoicesBody) -> dict[str, Any]:
    return body.model_dump()
