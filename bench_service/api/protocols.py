"""Protocols: tests as data, in our own schema or that of aurora-unicycler."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fastapi import APIRouter

from bench_service.api.answers import asked, keyed, listed, paged, record, shown
from bench_service.api.dependencies import Answer, PageOf, PathId, ServicesOf
from bench_service.api.strict import Body, BulkRoute, Id, Positive, Soc
from bench_service.campaign.protocols import add_protocol, look_ahead
from bench_service.protocol.library import standard_tests

router = APIRouter(prefix="/protocols", tags=["protocols"], route_class=BulkRoute)
tests_router = APIRouter(prefix="/standard-tests", tags=["protocols"])


class ProtocolBody(Body):
    """A protocol to store: a document, or a standard test of the library with what differs from its defaults.

    A standard test, and a design block, are made for a bench: for its limits and its cell's capacity.
    """

    document: dict[str, Any] | None = None
    standard_test: Id | None = None
    parameters: dict[str, Any] = {}
    bench: Id | None = None


class LookAheadBody(ProtocolBody):
    """A protocol, stored or not, to look at before it is started."""

    protocol_id: Id | None = None
    initial_soc: Soc = 0.5
    dt_s: Positive = 1.0


@router.post(
    "", status_code=201, openapi_extra=record("Protocol") | asked({"standard_test": "pulse_resistance", "bench": "sim"})
)
async def add(body: ProtocolBody, services: ServicesOf) -> Answer:
    """Check a protocol and store it."""
    return asdict(await add_protocol(services, body.model_dump()))


@router.post(
    "/preview",
    openapi_extra=keyed("name", "document", "steps", "limits", "duration_s")
    | asked({"standard_test": "pulse_resistance", "bench": "sim", "initial_soc": 0.5})
    | shown(
        {
            "name": "pulse resistance",
            "document": {},
            "steps": [],
            "limits": {"voltage_V": [2.5, 4.2]},
            "duration_s": 3600.0,
        }
    ),
)
async def preview(body: LookAheadBody, services: ServicesOf) -> Answer:
    """Say what a protocol would do on a bench: its steps, its length, current and voltage of a nominal cell."""
    return await services.aside.call(look_ahead, services, body.model_dump())


@router.get("", openapi_extra=paged("protocols", "Protocol"))
def list_protocols(services: ServicesOf, page: PageOf) -> Answer:
    """List protocols, newest first."""
    return page.answer(services, ("protocols", "protocol"), services.store.protocols.page(**page.asked), asdict)


@router.get("/{protocol_id}", openapi_extra=record("Protocol"))
def get_protocol(protocol_id: PathId, services: ServicesOf) -> Answer:
    """Give one protocol with its document."""
    return asdict(services.store.protocols.get(protocol_id)) | {
        "document": services.store.protocols.document(protocol_id)
    }


@tests_router.get(
    "",
    openapi_extra=listed("standard_tests")
    | shown({"standard_tests": [{"name": "pulse_resistance", "title": "Pulse resistance"}]}),
)
def list_standard_tests() -> Answer:
    """List the library of standard tests: what each is for, and its parameters."""
    return {"standard_tests": [test.to_json() for test in standard_tests()]}
