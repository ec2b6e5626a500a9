"""Runs: start, stop, look at."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field

from bench_service.api.answers import asked, paged, record
from bench_service.api.dependencies import Answer, CellFilter, PageOf, PathId, ServicesOf
from bench_service.api.strict import Body, Id, Name, Positive, Seed, Soc, StrictRoute, Window
from bench_service.campaign.cell_of_run import give_run
from bench_service.campaign.describing import describe_run
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.run_models import BandWish
from bench_service.errors import BadRequestError
from bench_service.store.records import RunState

router = APIRouter(prefix="/runs", tags=["runs"], route_class=StrictRoute)


class LimitsBody(Body):
    """Limits of a run; what is left out is as the bench has it."""

    voltage_V: Window | None = None
    current_A: Window | None = None
    temperature_degC: Window | None = None
    soc: Window | None = None
    ramp_A_per_s: Positive | None = None
    duration_s: Positive | None = None


class BandBody(Body):
    """A model whose band the voltage must not leave by more than a margin for longer than a time."""

    model_id: Id
    margin_V: Annotated[Positive, Field(le=10.0)] = 0.05
    for_s: Annotated[Positive, Field(le=86400.0)] = 30.0


class RunBody(Body):
    """A run to start."""

    bench: Id
    profile_id: Id | None = None
    protocol_id: Id | None = None
    dt_s: Annotated[Positive, Field(ge=1e-3, le=3600.0)]
    initial_soc: Soc
    limits: LimitsBody | None = None
    model_id: Id | None = None
    observer_initial_soc: Soc | None = None
    observer_gain: Literal["kalman", "steady"] | None = None
    name: Name | None = None
    seed: Seed | None = None
    finish_alone: bool = False
    band: BandBody | None = None
    learn: bool = Field(default=False, strict=True)
    continues: Id | None = None
    on_interruption: Literal["stop", "resume"] | None = None
    cell_id: Id | None = None


class DescriptionBody(Body):
    """What a person says of a run; ``cell_id`` is the cell that it belongs to."""

    label: Name | None = None
    operator: Name | None = None
    notes: Annotated[str, Field(min_length=1, max_length=20_000)] | None = None
    cell_id: Id | None = None


@router.post(
    "",
    status_code=201,
    openapi_extra=record("Run")
    | asked(
        {
            "bench": "sim",
            "profile_id": "56b84604",
            "dt_s": 0.1,
            "initial_soc": 0.5,
            "name": "first pulse",
            "limits": {"voltage_V": [2.6, 4.1]},
            "cell_id": "C1",
        }
    ),
)
async def start_run(body: RunBody, services: ServicesOf) -> Answer:
    """Start a run, after every check that needs no cycler."""
    if body.protocol_id is None and (body.continues is not None or body.on_interruption is not None):
        raise BadRequestError("only a protocol goes on after an interruption", ("protocol_id",), remedy="give one")
    given = body.model_dump(exclude={"limits", "band", "learn"})
    band = body.band and BandWish(**body.band.model_dump())
    order = RunOrder(**given, limits=body.limits and body.limits.model_dump(), band=band)
    start = services.learning.start_run if body.learn else services.runs.start
    return asdict(await start(services.benches, order))


@router.get("", openapi_extra=paged("runs", "Run"))
def list_runs(
    services: ServicesOf,
    page: PageOf,
    bench: Annotated[str | None, Query(max_length=64)] = None,
    state: RunState | None = None,
    campaign_id: Annotated[str | None, Query(max_length=64)] = None,
    q: Annotated[str | None, Query(max_length=200)] = None,
    cell_id: CellFilter = None,
) -> Answer:
    """List runs, newest first; with ``q`` those in whose name, label, operator, notes, bench or date each word is."""
    found = services.store.runs.page(bench, state, campaign_id, words=q, cell_id=cell_id, **page.asked)
    return page.answer(services, ("runs", "run"), found, asdict)


@router.get("/{run_id}", openapi_extra=record("Run"))
def get_run(run_id: PathId, services: ServicesOf) -> Answer:
    """Give one run."""
    return asdict(services.store.runs.get(run_id))


@router.patch(
    "/{run_id}",
    openapi_extra=record("Run")
    | asked({"label": "first pulse", "operator": "Bo", "notes": "The cell was warm to the hand.", "cell_id": "C1"}),
)
async def describe(run_id: PathId, body: DescriptionBody, services: ServicesOf) -> Answer:
    """Write label, operator, notes or cell of a run; what is left out stays, null takes it away. Kept as an event.

    Models, comparisons and diagnoses that were made from the run go with it to another cell.
    """
    told = body.model_dump(exclude_unset=True)
    if "cell_id" in told:
        run = await give_run(services.store, services.journal, run_id, told.pop("cell_id"))
        if not told:
            return asdict(run)
    return asdict(await describe_run(services.store, services.journal, run_id, told))


@router.post("/{run_id}/stop", openapi_extra=record("Run"))
async def stop_run(run_id: PathId, services: ServicesOf) -> Answer:
    """Stop a run: rest, output off. One that has ended stays as it is."""
    run = await asyncio.to_thread(services.store.runs.get, run_id)
    services.runs.stop(services.benches, run, "stopped by a client")
    return asdict(run)
