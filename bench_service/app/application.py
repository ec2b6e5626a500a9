"""The FastAPI application: routes, errors, guards, and the life of everything behind them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from importlib.metadata import version

from fastapi import APIRouter, FastAPI

from bench_service.api import (
    benches,
    campaigns,
    cells,
    commissioning,
    comparisons,
    designs,
    diagnoses,
    effects,
    events,
    formats,
    health,
    imports,
    jobs,
    live,
    models,
    observations,
    profiles,
    protocols,
    reports,
    run_steps,
    runs,
    samples,
    trends,
)
from bench_service.api.compression import Compression
from bench_service.api.errors import install_error_handlers
from bench_service.api.gate import Gate
from bench_service.api.response_schemas import described
from bench_service.app.lifespan import running_services
from bench_service.app.memory import GivesBack
from bench_service.campaign.services import Services
from bench_service.config import ServiceConfig
from bench_service.store.metadata import MetadataStore
from bench_service.web import routes as web

_RESOURCES = (
    benches,
    cells,
    profiles,
    protocols,
    runs,
    run_steps,
    samples,
    events,
    formats,
    models,
    jobs,
    comparisons,
    observations,
    diagnoses,
    trends,
    effects,
    designs,
    campaigns,
    commissioning,
    imports,
    reports,
    live,
)


def create_app(
    config: ServiceConfig, *, host: str = "127.0.0.1", services: Services | None = None, token: str | None = None
) -> FastAPI:
    """Build the application.

    Parameters
    ----------
    config : ServiceConfig
    host : str
        Name or address that it will be bound to; requests to other hosts are refused.
    services : Services or None
        The running parts; None: the application starts them with itself, and stops them at its end.
    token : str or None
        That requests must carry, see `config.token`.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        with closing(MetadataStore.open(config.data_dir)) as store:
            async with running_services(config, store) as own_services:
                app.state.services = own_services
                yield

    app = FastAPI(
        title="Battery test bench service",
        version=version("bench-service"),
        lifespan=lifespan if services is None else None,
        openapi_url="/api/v1/openapi.json",
        # The stock documentation pages load their scripts from other hosts; ours is `/reference`.
        docs_url=None,
        redoc_url=None,
    )
    bare = app.openapi
    app.openapi = lambda: described(bare())
    app.state.services = services
    app.add_middleware(Compression)
    app.add_middleware(Gate, host=host, token=token)
    app.add_middleware(GivesBack)
    install_error_handlers(app)
    api = APIRouter(prefix="/api/v1")
    for resource in _RESOURCES:
        api.include_router(resource.router)
    api.include_router(protocols.tests_router)
    api.include_router(models.bulk_router)
    api.include_router(imports.upload_router)
    api.include_router(imports.mapping_router)
    app.include_router(api)
    app.include_router(health.router)
    app.include_router(web.router)
    return app
