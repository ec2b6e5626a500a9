"""Bodies are taken literally: unknown keys, NaN, infinities, numbers as text and booleans as numbers are refused."""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine
from typing import Annotated, Any, ClassVar, NoReturn, TypeVar

from fastapi import Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from starlette.exceptions import HTTPException
from starlette.types import Message, Receive

JSON_TYPE = "application/json"
CSV_TYPE = "text/csv"
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
        """Parse the body.

        Raises
        ------
        json.JSONDecodeError
            Not JSON; NaN or Infinity as a token; a key that appears twice; nested too deeply.
        """
        if not hasattr(self, "_json"):
            self._json = _parse(await self.body())
        return self._json


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
        return model.model_validate(await request.json())
    except json.JSONDecodeError as error:
        fault = {"type": "json_invalid", "loc": ("body", error.pos), "msg": "", "ctx": {"error": error.msg}}
        raise RequestValidationError([fault]) from error
    except ValidationError as error:
        faults = error.errors(include_url=False, include_input=False, include_context=False)
        raise RequestValidationError([{**fault, "loc": ("body", *fault["loc"])} for fault in faults]) from error


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


def _parse(body: bytes) -> Any:
    try:
        return json.loads(body, parse_constant=_refuse_constant, object_pairs_hook=_unique)
    except json.JSONDecodeError:
        raise
    except RecursionError as error:
        raise json.JSONDecodeError("nested too deeply", "", 0) from error
    except ValueError as error:  # no UTF-8, a number of thousands of digits, or one of the hooks
        raise json.JSONDecodeError(str(error)[:200], "", 0) from error


def _refuse_constant(token: str) -> NoReturn:
    raise ValueError(f"{token} is not a JSON number; every number must be finite")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"key {twice[:100]!r} appears twice")
    return found
