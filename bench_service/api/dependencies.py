"""How a route gets at the parts of the service."""

from __future__ import annotations

from typing import Annotated, Any, cast

from fastapi import Depends, Path, Query
from starlette.requests import HTTPConnection

from bench_service.campaign.services import Services

# A JSON object as it goes out; its keys are those of the record that it is made from.
Answer = dict[str, Any]


def services_of(connection: HTTPConnection) -> Services:
    """Give the parts that the application has put together; for requests and WebSockets alike."""
    return cast(Services, connection.app.state.services)


ServicesOf = Annotated[Services, Depends(services_of)]
PathId = Annotated[str, Path(min_length=1, max_length=64)]
Limit = Annotated[int, Query(ge=1, le=1000)]
CellFilter = Annotated[str | None, Query(max_length=64)]
Offset = Annotated[int, Query(ge=0, le=10**9)]
