"""Observers on stored runs: what a model's observer would have said of the state of charge, and how good that is."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter
from pydantic import Field

from bench_service.api.answers import asked, job
from bench_service.api.dependencies import Answer, ServicesOf
from bench_service.api.strict import Body, Id, Soc, StrictRoute
from bench_service.campaign.observing import ObservationOrder

router = APIRouter(prefix="/observations", tags=["observations"], route_class=StrictRoute)


class ObservationBody(Body):
    """Runs to observe; ``initial_soc`` is where the observer begins, by default where each run is said to begin."""

    model_id: Id
    run_ids: Annotated[list[Id], Field(min_length=1, max_length=100)]
    initial_soc: Soc | None = None
    gain: Literal["kalman", "steady"] | None = None


@router.post(
    "",
    status_code=202,
    openapi_extra=job()
    | asked({"model_id": "1e2ec3ed", "run_ids": ["c49cf9aa"], "initial_soc": 0.3, "gain": "kalman"}),
)
async def start_observation(body: ObservationBody, services: ServicesOf) -> Answer:
    """Replay runs through a model's observer in a worker; answers with the job, whose result is that of `observe`."""
    return asdict(await services.observing.start_observation(ObservationOrder(**body.model_dump())))
