"""Events: what happened, for the people at the bench."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter

from bench_service.api.answers import paged
from bench_service.api.dependencies import Answer, PageOf, PathId, ServicesOf

router = APIRouter(tags=["events"])


@router.get("/events", openapi_extra=paged("events", "Event"))
def list_events(services: ServicesOf, page: PageOf) -> Answer:
    """List the newest events."""
    return page.answer(services, ("events", "event"), services.store.events.page(**page.asked), asdict)


@router.get("/runs/{run_id}/events", openapi_extra=paged("events", "Event"))
def list_run_events(run_id: PathId, services: ServicesOf, page: PageOf) -> Answer:
    """List the newest events of one run."""
    services.store.runs.get(run_id)
    return page.answer(services, ("events", "event"), services.store.events.page(run_id, **page.asked), asdict)
