"""Benches: what they are and do, stop, acknowledge."""

from __future__ import annotations

import asyncio
from dataclasses import asdict

from fastapi import APIRouter

from bench_service.api.answers import bench, benches, keyed, shown
from bench_service.api.dependencies import Answer, PathId, ServicesOf
from bench_service.api.strict import StrictRoute
from bench_service.campaign.request import known_standing
from bench_service.campaign.standing import last_standing
from bench_service.errors import BadRequestError, NotFoundError

router = APIRouter(prefix="/benches", tags=["benches"], route_class=StrictRoute)


@router.get("", openapi_extra=benches())
async def list_benches(services: ServicesOf) -> Answer:
    """List all benches."""
    return {"benches": [bench.to_json() for bench in services.benches]}


@router.get("/{name}", openapi_extra=bench())
async def get_bench(name: PathId, services: ServicesOf) -> Answer:
    """Give one bench."""
    return services.benches.get(name).to_json()


@router.get(
    "/{name}/standing", openapi_extra=keyed("soc", "source") | shown({"soc": 0.5, "source": "the configuration"})
)
async def get_standing(name: PathId, services: ServicesOf) -> Answer:
    """Tell the state of charge at which the cell stands, as far as that is known; 404 where nobody knows."""
    bench = services.benches.get(name)
    last = await asyncio.to_thread(last_standing, bench, services.store, services.samples)
    try:
        return asdict(known_standing(bench, None, last))
    except BadRequestError as error:
        raise NotFoundError(str(error), ("name",)) from error


@router.post("/{name}/stop", openapi_extra=keyed("state") | shown({"state": "stopping"}))
async def stop_bench(name: PathId, services: ServicesOf) -> Answer:
    """Stop the run on the bench: rest, output off. Harmless where nothing runs."""
    bench = services.runs.stop_bench(services.benches, name, "stopped by a client")
    return {"state": bench.supervisor.status.state}


@router.post("/{name}/pause", openapi_extra=keyed("state") | shown({"state": "paused"}))
async def pause(name: PathId, services: ServicesOf) -> Answer:
    """Hold the run on the bench: output off, the profile waits; 409 where nothing runs."""
    return {"state": services.runs.hold(services.benches, name, on=True).supervisor.status.state}


@router.post("/{name}/skip", openapi_extra=keyed("state") | shown({"state": "running"}))
async def skip(name: PathId, services: ServicesOf) -> Answer:
    """End the step of the protocol that plays on the bench, and go on to the next; 409 where there is none."""
    return {"state": services.runs.skip(services.benches, name).supervisor.status.state}


@router.post("/{name}/resume", openapi_extra=keyed("state") | shown({"state": "running"}))
async def resume(name: PathId, services: ServicesOf) -> Answer:
    """Let a run that is held go on; 409 where nothing runs."""
    return {"state": services.runs.hold(services.benches, name, on=False).supervisor.status.state}


@router.get(
    "/{name}/stop-port",
    openapi_extra=keyed("url", "token") | shown({"url": "http://127.0.0.1:37259", "token": "Co2eBHXk"}),
)
async def stop_port(name: PathId, services: ServicesOf) -> Answer:
    """Tell a page or program on this machine how to stop the bench past this service; 404 where it cannot."""
    endpoint = services.benches.get(name).supervisor.stop_endpoint
    if endpoint is None:
        raise NotFoundError(f"bench {name} has no stop port", ("name",))
    return {"url": endpoint.ticket.url, "token": endpoint.ticket.token}


@router.post(
    "/{name}/seal/open",
    openapi_extra=keyed("sha256", "opened") | shown({"sha256": "17423f6d", "opened": "capacity=2.332 47bfd201"}),
)
async def open_seal(name: PathId, services: ServicesOf) -> Answer:
    """Tell which effect is hidden in a simulated cell, and of what size; from then on everybody sees it."""
    return await services.benches.open_seal(name)


@router.get(
    "/{name}/queue",
    openapi_extra=keyed("bench", "held", "waiting", "hours")
    | shown({"bench": "sim", "held": None, "waiting": [], "hours": 0.0}),
)
async def get_queue(name: PathId, services: ServicesOf) -> Answer:
    """List the campaigns that wait on a bench, and why they do where nothing goes on by itself."""
    return await services.campaigns.queue.to_json(services.benches.get(name).name)


@router.post(
    "/{name}/queue/start",
    openapi_extra=keyed("bench", "held", "waiting", "hours")
    | shown({"bench": "sim", "held": None, "waiting": [], "hours": 0.0}),
)
async def start_queue(name: PathId, services: ServicesOf) -> Answer:
    """Let a queue go on that waits since a campaign was not completed; that one does not run again."""
    await services.campaigns.queue.start(services.benches.get(name).name)
    return await services.campaigns.queue.to_json(name)


@router.post("/{name}/acknowledge", openapi_extra=bench())
async def acknowledge(name: PathId, services: ServicesOf) -> Answer:
    """Clear a latched fault; the answer shows the bench a moment later."""
    return (await services.benches.acknowledge(name)).to_json()
