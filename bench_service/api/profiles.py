"""Profiles: currents over time, forward hold, the last row ends them."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query, Request

from bench_service.api.answers import asked, paged, record
from bench_service.api.csv_body import read_csv_profile
from bench_service.api.dependencies import Answer, PageOf, PathId, ServicesOf
from bench_service.api.strict import (
    CSV_TYPE,
    JSON_TYPE,
    Body,
    BulkRoute,
    Name,
    Number,
    read_json,
    require_content_type,
)
from bench_service.campaign.admission import check_profile
from bench_service.errors import BadRequestError

router = APIRouter(prefix="/profiles", tags=["profiles"], route_class=BulkRoute)


class ProfileBody(Body):
    """A profile as JSON."""

    name: Name
    time_s: list[Number]
    current_A: list[Number]


_ACCEPTED = {
    "requestBody": {
        "required": True,
        "content": {
            JSON_TYPE: {"schema": ProfileBody.model_json_schema()},
            CSV_TYPE: {"schema": {"type": "string", "description": "header time_s,current_A"}},
        },
    }
}


@router.post(
    "",
    status_code=201,
    openapi_extra=_ACCEPTED
    | record("Profile")
    | asked({"name": "one pulse", "time_s": [0.0, 60.0, 120.0], "current_A": [0.0, 1.0, 0.0]}),
)
async def add_profile(
    request: Request, services: ServicesOf, name: Annotated[str | None, Query(min_length=1, max_length=200)] = None
) -> Answer:
    """Store a profile from JSON, or from CSV with its name in the query."""
    if require_content_type(request, JSON_TYPE, CSV_TYPE) == JSON_TYPE:
        body = await read_json(request, ProfileBody)
        name, time_s, current_A = body.name, np.array(body.time_s), np.array(body.current_A)
    elif name is None:
        raise BadRequestError("a CSV profile needs its name in the query, ?name=", ("name",))
    else:
        profile = await asyncio.to_thread(read_csv_profile, await request.body())
        time_s, current_A = profile.time_s, profile.current_A
    check_profile(time_s, current_A)
    return asdict(await services.journal.write(services.store.profiles.add, name, time_s, current_A))


@router.get("", openapi_extra=paged("profiles", "Profile"))
def list_profiles(services: ServicesOf, page: PageOf) -> Answer:
    """List profiles, newest first."""
    return page.answer(services, ("profiles", "profile"), services.store.profiles.page(**page.asked), asdict)


@router.get("/{profile_id}", openapi_extra=record("Profile"))
def get_profile(profile_id: PathId, services: ServicesOf, points: bool = False) -> Answer:
    """Give one profile, with ``points=true`` also its rows."""
    profile = asdict(services.store.profiles.get(profile_id))
    if points:
        time_s, current_A = services.store.profiles.points(profile_id)
        profile |= {"time_s": time_s.tolist(), "current_A": current_A.tolist()}
    return profile
