"""Commissioning of a bench: what is known of its hardware, and how it comes to be known."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter
from pydantic import Field

from bench_service.api.answers import asked, keyed, shown
from bench_service.api.dependencies import Answer, PathId, ServicesOf
from bench_service.api.strict import Body, Positive, StrictRoute
from bench_service.bench.commissioning.check import ProofOrder

router = APIRouter(prefix="/benches", tags=["commissioning"], route_class=StrictRoute)


class CommissionBody(Body):
    """What is to be done; without ``confirm`` the device is read and nothing is written."""

    confirm: bool = False
    current_A: Annotated[Positive, Field(le=1e5)] | None = None
    resistor_Ohm: Annotated[Positive, Field(le=1e3)] | None = None


@router.get(
    "/{name}/commissioning",
    openapi_extra=keyed("bench", "record")
    | shown(
        {"bench": "rig", "state": "missing", "reason": "nobody has commissioned it", "record": None, "identity": None}
    ),
)
def get_commissioning(name: PathId, services: ServicesOf) -> Answer:
    """Tell whether the bench's hardware is commissioned, why not, and give the newest record."""
    return services.commissioning.standing(name)


@router.post(
    "/{name}/commission",
    openapi_extra=keyed("bench", "record", "sha256", "state")
    | asked({"confirm": True, "current_A": 0.5})
    | shown({"bench": "rig", "record": "5d0f9a", "sha256": "09ba53c2", "state": "passed"}),
)
async def commission(name: PathId, body: CommissionBody, services: ServicesOf) -> Answer:
    """Look at the bench's device; with ``confirm``, let small currents flow and prove sign, watchdog, limits, stop.

    Answers when it is done, after some 15 s; a stop ends it as it ends a run.
    """
    settle_s = services.benches.get(name).config.settle_s
    order = ProofOrder(body.confirm, body.current_A, body.resistor_Ohm, settle_s)
    return await services.commissioning.commission(name, order)
