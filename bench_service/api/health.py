"""`/healthz`: whether the service and its processes are alive."""

from __future__ import annotations

from fastapi import APIRouter

from bench_service.api.answers import keyed, shown
from bench_service.api.dependencies import Answer, ServicesOf
from bench_service.store.engine import check_sqlite

router = APIRouter(tags=["service"])


@router.get(
    "/healthz",
    openapi_extra=keyed("status", "version", "recorder", "storage", "benches", "sqlite_version")
    | shown(
        {
            "status": "ok",
            "version": "0.1.0",
            "recorder": "running",
            "storage": {"state": "ok"},
            "benches": {"sim": "idle"},
            "sqlite_version": "3.45.1",
        }
    ),
)
async def health(services: ServicesOf) -> Answer:
    """Answer with versions and states."""
    recorder, storage = services.recorder_state(), services.storage.to_json()
    sound = recorder == "running" and storage["state"] == "ok" and not storage["damaged_runs"]
    return {
        "status": "ok" if sound else "degraded",
        "version": services.version,
        "recorder": recorder,
        "storage": storage,
        "benches": {bench.name: bench.supervisor.status.state for bench in services.benches},
        "sqlite_version": check_sqlite(),
    }
