"""What the steps and cycles of a run have moved."""

from __future__ import annotations

import math
from typing import Any

from fastapi import APIRouter

from bench_service.api.answers import listed
from bench_service.api.dependencies import Answer, PathId, ServicesOf
from bench_service.campaign.run_counters import cycles_of, steps_of

router = APIRouter(prefix="/runs", tags=["runs"])


@router.get("/{run_id}/steps", openapi_extra=listed("steps"))
def get_steps(run_id: PathId, services: ServicesOf) -> Answer:
    """Give one object for each step of a protocol that has ended, in the order in which they were played."""
    return {"steps": [_finite(step) for step in steps_of(services.store, services.samples, run_id)]}


@router.get("/{run_id}/cycles", openapi_extra=listed("cycles"))
def get_cycles(run_id: PathId, services: ServicesOf) -> Answer:
    """Give one object for each cycle of a protocol: capacity, energy, mean voltages, efficiencies."""
    return {"cycles": [_finite(cycle) for cycle in cycles_of(services.store, services.samples, run_id)]}


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()}
