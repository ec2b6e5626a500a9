"""Jobs: how far long work is."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter

from bench_service.api.answers import job
from bench_service.api.dependencies import Answer, PathId, ServicesOf
from bench_service.api.strict import StrictRoute

router = APIRouter(prefix="/jobs", tags=["jobs"], route_class=StrictRoute)


@router.get("/{job_id}", openapi_extra=job())
async def get_job(job_id: PathId, services: ServicesOf) -> Answer:
    """Give one job."""
    return asdict(services.jobs.get(job_id))


@router.post("/{job_id}/cancel", openapi_extra=job())
async def cancel_job(job_id: PathId, services: ServicesOf) -> Answer:
    """End a job; it becomes ``failed`` with the error ``cancelled``. One that has ended stays as it is."""
    services.jobs.cancel(job_id)
    return asdict(services.jobs.get(job_id))
