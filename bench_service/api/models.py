"""Models: fit, import, look at."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request
from pydantic import Field

from bench_service.api.answers import asked, job, keyed, paged, record, shown
from bench_service.api.dependencies import Answer, CellFilter, PageOf, PathId, ServicesOf
from bench_service.api.strict import (
    JSON_TYPE,
    Body,
    BulkRoute,
    Id,
    Name,
    Positive,
    Seed,
    Soc,
    StrictRoute,
    read_object,
    require_content_type,
)
from bench_service.campaign.modelling import FitOrder, ModuleOrder
from bench_service.jobs.screening import MODEL

router = APIRouter(prefix="/models", tags=["models"], route_class=StrictRoute)
bulk_router = APIRouter(prefix="/models", tags=["models"], route_class=BulkRoute)


Count = Annotated[int, Field(strict=True, ge=1, le=10_000)]


class ModuleBody(Body):
    """The runs are of a module; ``in_series`` by default as many as the runs have voltages of."""

    in_series: Count | None = None
    parallel: Count = 1
    cell_model_id: Id | None = None


class FitBody(Body):
    """A model to identify."""

    name: Name
    train: Annotated[list[Id], Field(min_length=1, max_length=100)]
    validation: Annotated[list[Id], Field(alias="validate", max_length=100)] = []
    capacity_Ah: Positive
    structure: Literal["auto", "full", "minimal", "bounded", "searched"] = "auto"
    without: Annotated[list[Name], Field(max_length=100)] = []
    initial_soc_std: Soc = 0.0
    coulombic_efficiency: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=1)] = 1.0
    seed: Seed | None = None
    module: ModuleBody | None = None


@router.post(
    "",
    status_code=202,
    openapi_extra=job()
    | asked(
        {
            "name": "left cell",
            "train": ["c49cf9aa"],
            "validate": ["96fcc6a2"],
            "capacity_Ah": 2.5,
            "structure": "auto",
            "initial_soc_std": 0.02,
        }
    ),
)
async def start_fit(body: FitBody, services: ServicesOf) -> Answer:
    """Fit a model to runs in a worker process; answers with the job."""
    order = FitOrder(
        name=body.name,
        train=body.train,
        validate=body.validation,
        capacity_Ah=body.capacity_Ah,
        structure=body.structure,
        without=body.without,
        initial_soc_std=body.initial_soc_std,
        coulombic_efficiency=body.coulombic_efficiency,
        seed=body.seed,
        module=body.module and ModuleOrder(**body.module.model_dump()),
    )
    return asdict(await services.modelling.start_fit(order))


_DOCUMENT = {"requestBody": {"required": True, "content": {JSON_TYPE: {"schema": {"type": "object"}}}}}


@bulk_router.post("/import", status_code=201, openapi_extra=_DOCUMENT | record("Model"))
async def import_model(
    request: Request,
    services: ServicesOf,
    name: Annotated[str, Query(min_length=1, max_length=200)] = "imported",
    cell_id: CellFilter = None,
) -> Answer:
    """Store a MODEL.json."""
    require_content_type(request, JSON_TYPE)
    request.scope["screened_as"] = MODEL
    document = await read_object(request)
    return asdict(await asyncio.to_thread(services.modelling.import_model, document, name, cell_id))


@router.get("", openapi_extra=paged("models", "Model"))
def list_models(services: ServicesOf, page: PageOf, cell_id: CellFilter = None) -> Answer:
    """List models, newest first, without their documents; those of one cell where it is given."""
    found = services.store.models.page(cell_id=cell_id, **page.asked)
    return page.answer(services, ("models", "model"), found, asdict)


@router.get("/{model_id}", openapi_extra=record("Model"))
def get_model(model_id: PathId, services: ServicesOf) -> Answer:
    """Give one model with its metrics."""
    return asdict(services.store.models.get(model_id))


@router.get("/{model_id}/document", openapi_extra=keyed() | shown({"schema_version": 1, "kind": "local_model_network"}))
def get_document(model_id: PathId, services: ServicesOf) -> Answer:
    """Give the model itself, MODEL.json."""
    return services.store.models.document(model_id)


@router.get(
    "/{model_id}/tables",
    openapi_extra=keyed("thermal", "residuals", "usability", "local_models")
    | shown(
        {
            "ocv": {"soc": [0.2, 0.8], "mean_V": [[3.55, 3.98]]},
            "thermal": None,
            "residuals": [],
            "usability": {"verdict": "usable", "reasons": []},
            "local_models": None,
        }
    ),
)
async def get_tables(model_id: PathId, services: ServicesOf) -> Answer:
    """Give what is read out of a model: open-circuit voltage, resistance and step responses with bands, heat."""
    return await services.modelling.tables(model_id)
