"""Every error answer has one form: ``{"error": {"code", "message", "where"}}``; who asks for it gets RFC 9457's."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any, cast

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.types import Receive, Scope, Send

from bench_service.campaign.live import TooManyReadersError
from bench_service.errors import (
    BadRequestError,
    BenchOfflineError,
    ConflictError,
    DamagedError,
    GivenUpError,
    NoRoomError,
    NotFoundError,
    ServiceError,
    StoreError,
)
from bench_service.exchange.errors import ExchangeError
from bench_service.reports.pdf import NoPrinterError
from models.data.errors import ModelError

_PROBLEM = "application/problem+json"
_log = logging.getLogger(__name__)

# The first class that fits counts.
_STATUS: tuple[tuple[type[Exception], int, str], ...] = (
    (NotFoundError, 404, "not_found"),
    (ConflictError, 409, "conflict"),
    (BadRequestError, 422, "bad_request"),
    (GivenUpError, 410, "given_up"),
    (DamagedError, 409, "damaged"),
    (NoRoomError, 507, "no_room"),
    (BenchOfflineError, 503, "bench_offline"),
    (StoreError, 503, "store"),
    (TooManyReadersError, 503, "too_many_readers"),
    (ExchangeError, 422, "bad_file"),
    (ModelError, 422, "not_identifiable"),
    (NoPrinterError, 501, "no_pdf"),
    (ServiceError, 500, "error"),
)
_HTTP_CODES = {400: "bad_request", 403: "forbidden", 404: "not_found", 405: "method_not_allowed", 413: "too_large"}
_HTTP_CODES |= {415: "wrong_content_type", 422: "bad_request"}


class ErrorResponse(JSONResponse):
    """An error in the service's own form, or as ``application/problem+json`` for whoever accepts that (RFC 9457)."""

    def __init__(self, status: int, told: dict[str, Any]) -> None:
        super().__init__({"error": told}, status_code=status)
        self._told = told

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        if _PROBLEM in Headers(scope=scope).get("accept", ""):
            title = HTTPStatus(self.status_code).phrase
            told = {"type": "about:blank", "title": title, "status": self.status_code, "detail": self._told["message"]}
            self.body = self.render(told | {"code": self._told["code"], "where": self._told["where"]})
            self.headers["content-type"], self.headers["content-length"] = _PROBLEM, str(len(self.body))
        await super().__call__(scope, receive, send)


def error_response(status: int, code: str, message: str, where: Sequence[Any] | None = None) -> ErrorResponse:
    """Build an error answer; text that is not UTF-8 able is shown with replacement characters."""
    places = [part if isinstance(part, int) else _plain(str(part)) for part in where] if where else None
    return ErrorResponse(status, {"code": code, "message": _plain(message), "where": places})


def install_error_handlers(app: FastAPI) -> None:
    """Make every error of the application take the one form."""
    for error_type, _, _ in _STATUS:
        app.add_exception_handler(error_type, _on_own_error)
    app.add_exception_handler(RequestValidationError, _on_bad_request)
    app.add_exception_handler(HTTPException, _on_http_error)
    app.add_exception_handler(ClientDisconnect, _on_gone_client)
    app.add_exception_handler(Exception, _on_unexpected_error)


async def _on_own_error(request: Request, error: Exception) -> JSONResponse:
    status, code = next((status, code) for kind, status, code in _STATUS if isinstance(error, kind))
    where = error.where if isinstance(error, ServiceError) else None
    if isinstance(error, ServiceError):
        code = error.code
    return error_response(status, code, str(error), where)


async def _on_bad_request(request: Request, error: Exception) -> JSONResponse:
    # FastAPI's own handler echoes the input, and breaks where that is NaN.
    faults = cast(RequestValidationError, error).errors()
    first = faults[0]
    where = [part for part in first["loc"] if part not in ("body", "query", "path")]
    if first["type"] == "json_invalid":
        return error_response(422, "bad_json", f"the body is not JSON: {first['ctx']['error']}")
    reason = str(first["msg"]).removeprefix("Value error, ")
    more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    place = ".".join(str(part) for part in where) or "body"
    return error_response(422, "bad_request", f"{place}: {reason}{more}", where)


async def _on_http_error(request: Request, error: Exception) -> JSONResponse:
    http = cast(HTTPException, error)
    message = str(http.detail)
    if http.status_code == 404 and message == "Not Found":
        message = f"no such address: {request.url.path[:200]}"
    code = _HTTP_CODES.get(http.status_code, "error")
    answer = error_response(http.status_code, code, message)
    answer.headers.update(http.headers or {})
    return answer


async def _on_gone_client(request: Request, error: Exception) -> JSONResponse:
    # Nobody reads this. That somebody hung up in the middle of an upload is no news for the log either.
    return error_response(400, "bad_request", "the body did not come to its end")


async def _on_unexpected_error(request: Request, error: Exception) -> JSONResponse:
    return error_response(500, "internal", "an error inside the service; its log says which")


def _plain(text: str) -> str:
    return text.encode("utf-8", "replace").decode()
