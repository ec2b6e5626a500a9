"""Campaigns: design, run, fit, observe, compare and report in one go."""

from __future__ import annotations

import asyncio
from typing import Annotated, Literal

from fastapi import APIRouter
from pydantic import Field

from bench_service.api.answers import asked, keyed, paged, record, shown
from bench_service.api.dependencies import Answer, PageOf, PathId, ServicesOf
from bench_service.api.strict import Body, Id, Name, Positive, Seed, Soc, StrictRoute, Window
from bench_service.campaign.endings import campaign_json
from bench_service.campaign.request import MOST_ROUNDS

router = APIRouter(prefix="/campaigns", tags=["campaigns"], route_class=StrictRoute)


class CampaignBody(Body):
    """A campaign; what is left out follows from the bench. ``duration_s`` is that of each run.

    ``without``: effects that its model, a bounded network, is to lack.
    """

    bench: Id
    name: Name | None = None
    seed: Seed | None = None
    dt_s: Annotated[Positive, Field(ge=1e-3, le=3600.0)] | None = None
    duration_s: Positive | None = None
    capacity_Ah: Positive | None = None
    current_A: Window | None = None
    soc: Annotated[tuple[Soc, Soc], Field(strict=False)] | None = None
    initial_soc: Soc | None = None
    structure: Literal["auto", "full", "minimal", "bounded", "searched"] | None = None
    without: Annotated[list[Name], Field(max_length=100)] | None = None
    rounds: Annotated[int, Field(ge=1, le=MOST_ROUNDS)] | None = None
    diagnose: Literal["structure", "change"] | None = None
    changed_bench: Id | None = None
    on_interruption: Literal["stop", "resume"] | None = None
    queue: bool | None = None
    retries: Annotated[int, Field(ge=0, le=5)] | None = None


@router.post(
    "",
    status_code=201,
    openapi_extra=record("Campaign")
    | asked(
        {
            "bench": "sim",
            "name": "first look",
            "duration_s": 15000.0,
            "capacity_Ah": 2.5,
            "current_A": [-5.0, 2.5],
            "soc": [0.15, 0.8],
            "rounds": 2,
            "diagnose": "structure",
            "seed": 1,
        }
    ),
)
async def start_campaign(body: CampaignBody, services: ServicesOf) -> Answer:
    """Start a campaign; it goes on in the service, whether its client stays or not."""
    return campaign_json(await services.campaigns.start(body.model_dump()))


@router.post(
    "/estimate",
    openapi_extra=keyed()
    | asked({"bench": "sim", "duration_s": 15000.0, "rounds": 2})
    | shown({"runs": 3, "test_s": 45000.0, "real_s": 45000.0, "hours": 12.5, "refused": None}),
)
async def estimate_campaign(body: CampaignBody, services: ServicesOf) -> Answer:
    """Say how many hours of real time the runs of a campaign take, or why it would be refused, without starting it."""
    return await services.campaigns.estimate(body.model_dump())


@router.get("", openapi_extra=paged("campaigns", "Campaign"))
async def list_campaigns(services: ServicesOf, page: PageOf) -> Answer:
    """List campaigns, newest first."""
    found = await services.campaigns.list(**page.asked)
    return await asyncio.to_thread(page.answer, services, ("campaigns", "campaign"), found, campaign_json)


@router.get("/{campaign_id}", openapi_extra=record("Campaign"))
async def get_campaign(campaign_id: PathId, services: ServicesOf) -> Answer:
    """Give one campaign as it stands now."""
    return campaign_json(await services.campaigns.get(campaign_id))


@router.post("/{campaign_id}/resume", openapi_extra=record("Campaign"))
async def resume_campaign(campaign_id: PathId, services: ServicesOf) -> Answer:
    """Go on with a campaign that was cut off, from the last stored sample of its run."""
    return campaign_json(await services.campaigns.resume(campaign_id))


@router.post("/{campaign_id}/stop", openapi_extra=record("Campaign"))
async def stop_campaign(campaign_id: PathId, services: ServicesOf) -> Answer:
    """Stop a campaign and the run that it has started; one that has ended stays as it is."""
    return campaign_json(await services.campaigns.stop(campaign_id))
