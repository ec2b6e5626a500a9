"""Bodies are taken literally: unknown keys, NaN, infinities, numbers as text and booleans as numbers are refused."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Coroutine
from typing import Annotated, Any, ClassVar, TypeVar

from fastapi import Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from starlette.exceptions import HTTPException
from starlette.types import Message, Receive

from bench_service.strict_json import parse_strictly

JSON_TYPE = "application/json"
CSV_TYPE = "text/csv"
LONG_BODY_BYTES = 50_000
MAX_BODY_BYTES = 1_000_000
MAX_BULK_BODY_BYTES = 20_000_000


ModelT = TypeVar("ModelT", bound=BaseModel)


class Body(BaseModel):
    """Base of every request body."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


def _printable(text: str) -> str:
    if not text.isprintable() or text != text.strip():
        raise ValueError("must be printable text without spaces at its ends")
    return text


Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]
Id = Annotated[str, Field(min_length=1, max_length=64)]
# Strict mode still takes 1 for 1.0, as JSON does not tell them apart, but neither "1" nor true.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
# Above any capacity, time or rate that a laboratory knows; beyond it only overflows are found.
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=1e9)]
Soc = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
# JSON knows no tuples; only the two numbers inside are strict.
Window = Annotated[tuple[Number, Number], Field(strict=False)]


class StrictRequest(Request):
    """A request whose JSON follows RFC 8259 to the letter."""

    async def json(self) -> Any:
        """Parse the body; a long one is looked at in another process before this one spends its time on it.

        Raises
        ------
        json.JSONDecodeError
            Not JSON; NaN or Infinity as a token; a key that appears twice; nested too deeply.
        """
        if not hasattr(self, "_json"):
            body = await self.body()
            self._json = parse_strictly(body) if len(body) < LONG_BODY_BYTES else await self._parse_long(body)
        return self._json

    async def _parse_long(self, body: bytes) -> Any:
        services = getattr(self.app.state, "services", None) if "app" in self.scope else None
        if (screen := getattr(services, "screen", None)) is not None:
            await screen.check(body, self.scope.get("screened_as", "json"))
        return await asyncio.to_thread(parse_strictly, body)


class StrictRoute(APIRoute):
    """Route that reads JSON strictly, says 415 to any other kind of body and 413 to one that is too large."""

    max_bytes: ClassVar[int] = MAX_BODY_BYTES

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Wrap FastAPI's handler."""
        handle = super().get_route_handler()
        takes_body = self.body_field is not None

        async def handle_strictly(request: Request) -> Response:
            if takes_body:
                require_content_type(request, JSON_TYPE)
            return await handle(StrictRequest(request.scope, _limited(request, self.max_bytes)))

        return handle_strictly


class BulkRoute(StrictRoute):
    """Route whose body may be a long profile or a model."""

    max_bytes: ClassVar[int] = MAX_BULK_BODY_BYTES


def require_content_type(request: Request, *allowed: str) -> str:
    """Give the request's media type.

    Raises
    ------
    HTTPException
        415, if it is none of those allowed. (A form of another site's page can send neither.)
    """
    media_type = request.headers.get("content-type", "").split(";")[0].strip().lower()
    if media_type not in allowed:
        shown = media_type[:100] or "none"
        raise HTTPException(415, f"content type is {shown}; send {' or '.join(allowed)}")
    return media_type


async def read_json(request: Request, model: type[ModelT]) -> ModelT:
    """Validate the JSON body of a route that takes other media types as well.

    Raises
    ------
    RequestValidationError
        As FastAPI raises it for a declared body.
    """
    try:
        content = await request.json()
        return await asyncio.to_thread(model.model_validate, content)
    except json.JSONDecodeError as error:
        raise _no_json(error) from error
    except ValidationError as error:
        faults = error.errors(include_url=False, include_input=False, include_context=False)
        raise RequestValidationError([{**fault, "loc": ("body", *fault["loc"])} for fault in faults]) from error


async def read_object(request: Request) -> dict[str, Any]:
    """Read the JSON object in the body of a route that declares none; raises as `read_json`."""
    try:
        document = await request.json()
    except json.JSONDecodeError as error:
        raise _no_json(error) from error
    if not isinstance(document, dict):
        fault = {"type": "dict_type", "loc": ("body",), "msg": "Input should be a valid dictionary"}
        raise RequestValidationError([fault])
    return document


def _no_json(error: json.JSONDecodeError) -> RequestValidationError:
    fault = {"type": "json_invalid", "loc": ("body", error.pos), "msg": "", "ctx": {"error": error.msg}}
    return RequestValidationError([fault])


def _limited(request: Request, max_bytes: int) -> Receive:
    """Receive the body as far as it may go: never more than that is held."""
    announced = request.headers.get("content-length", "")
    received = 0

    async def receive() -> Message:
        nonlocal received
        if announced.isdecimal() and int(announced[:20]) > max_bytes:
            raise _too_large(announced[:20], max_bytes)
        message = await request.receive()
        received += len(message.get("body", b""))
        if received > max_bytes:
            raise _too_large(f"more than {max_bytes}", max_bytes)
        return message

    return receive


def _too_large(size: str, max_bytes: int) -> HTTPException:
    # Without the header the server would go on taking the rest in, to no use.
    close = {"Connection": "close"}
    return HTTPException(413, f"the body has {size} bytes, limit {max_bytes} bytes; send less", headers=close)
