"""Events: what happened, for the people at the bench."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter

from bench_service.api.answers import listed
from bench_service.api.dependencies import Answer, Limit, Offset, PathId, ServicesOf

router = APIRouter(tags=["events"])


@router.get("/events", openapi_extra=listed("events", "Event"))
def list_events(services: ServicesOf, limit: Limit = 100, offset: Offset = 0) -> Answer:
    """List the newest events."""
    return {"events": [asdict(event) for event in services.store.events.page(limit=limit, offset=offset)]}


@router.get("/runs/{run_id}/events", openapi_extra=listed("events", "Event"))
def list_run_events(run_id: PathId, services: ServicesOf, limit: Limit = 100, offset: Offset = 0) -> Answer:
    """List the newest events of one run."""
    services.store.runs.get(run_id)
    return {"events": [asdict(event) for event in services.store.events.page(run_id, limit, offset)]}
