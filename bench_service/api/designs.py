"""Designs: the test that tells the most about a cell, as a profile to be played."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter
from pydantic import JsonValue

from bench_service.api.answers import asked, job
from bench_service.api.dependencies import Answer, ServicesOf
from bench_service.api.strict import Body, Name, StrictRoute

router = APIRouter(prefix="/designs", tags=["designs"], route_class=StrictRoute)


class DesignBody(Body):
    """A design to make; the keys of `request` are those of a REQUEST file, with ids in place of files.

    ``rivals`` may also name effects, which are put into `model` and refitted to `runs`.
    """

    name: Name
    request: dict[str, JsonValue]


@router.post(
    "",
    status_code=202,
    openapi_extra=job()
    | asked(
        {
            "name": "next test",
            "request": {
                "model": "1e2ec3ed",
                "capacity_Ah": 2.5,
                "duration_s": 12000,
                "initial_soc": 0.5,
                "soc_levels": 4,
                "limits": {"current_A": [-5, 2.5], "voltage_V": [2.6, 4.2], "soc": [0.1, 0.9]},
            },
        }
    ),
)
async def start_design(body: DesignBody, services: ServicesOf) -> Answer:
    """Design a profile in a worker process; answers with the job, whose result names the stored profile."""
    return asdict(await services.designing.start(body.name, body.request, report=True))
