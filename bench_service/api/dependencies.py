"""How a route gets at the parts of the service."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, cast

from fastapi import Depends, Path, Query
from starlette.requests import HTTPConnection

from bench_service.campaign.services import Services
from bench_service.errors import BadRequestError

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
Cursor = Annotated[int | None, Query(ge=0, lt=2**63)]


@dataclass(frozen=True, slots=True)
class Page:
    """Which part of a list is asked for.

    Attributes
    ----------
    limit, offset : how many records, and how many before them are left out
    cursor : ``next_cursor`` of the page before: a record that comes or goes meanwhile moves no other to another page
    """

    limit: int
    offset: int
    cursor: int | None

    @property
    def asked(self) -> dict[str, Any]:
        """What the store is asked for: one record more than goes out, which tells whether there are more."""
        return {"limit": self.limit + 1, "offset": self.offset, "after": self.cursor}

    def answer(
        self, services: Services, names: tuple[str, str], found: list[Any], as_json: Callable[[Any], Any]
    ) -> Answer:
        """Answer with what was found under the first name, and where the next page begins.

        `names` are that of the list and that of the store's table.
        """
        shown = found[: self.limit]
        last = services.store.place(names[1], shown[-1].id) if len(found) > self.limit else None
        return {names[0]: [as_json(each) for each in shown], "next_cursor": last}


def _page(limit: Limit = 100, offset: Offset = 0, cursor: Cursor = None) -> Page:
    if offset and cursor is not None:
        raise BadRequestError("a page begins after a cursor or at an offset", ("cursor",), remedy="give one of both")
    return Page(limit, offset, cursor)


PageOf = Annotated[Page, Depends(_page)]
