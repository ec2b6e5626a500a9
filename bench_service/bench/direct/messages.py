"""HTTP as far as the stop port needs it: one small request in, one small JSON answer out. Pure.

A request is read by hand because what reads it must not grow with what is sent: a whole request has at most 4 KiB.
"""

from __future__ import annotations

import hmac
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

MAX_REQUEST_BYTES = 4096
OPERATIONS = ("stop", "acknowledge", "state")
_REASONS = {200: "OK", 204: "No Content", 400: "Bad Request", 401: "Unauthorized", 403: "Forbidden", 404: "Not Found"}
_REASONS |= {405: "Method Not Allowed", 413: "Content Too Large", 503: "Service Unavailable"}
_END = b"\r\n\r\n"


@dataclass(frozen=True, slots=True)
class Request:
    """One request.

    Parameters
    ----------
    method, path : str
    headers : mapping
        Names in lower case.
    body : str
    """

    method: str
    path: str
    headers: Mapping[str, str]
    body: str = ""


@dataclass(frozen=True, slots=True)
class Order:
    """What a request asks of the bench: ``stop``, ``acknowledge`` or ``state``, and why."""

    operation: str
    reason: str


@dataclass(frozen=True, slots=True)
class Guard:
    """Who may ask.

    Parameters
    ----------
    token : str
    origins : tuple of str
        Web pages that may read the answer: the service's own, such as ``http://127.0.0.1:8000``.
    """

    token: str
    origins: tuple[str, ...] = ()


class RefusedError(Exception):
    """A request that is not obeyed: `status` is that of HTTP."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


def read_request(data: bytes) -> Request | None:
    """Read a request; None while it is not whole.

    Raises
    ------
    RefusedError
        It is too long, or no HTTP.
    """
    if len(data) > MAX_REQUEST_BYTES:
        raise RefusedError(413, f"the request has more than {MAX_REQUEST_BYTES} bytes")
    head, found, rest = data.partition(_END)
    if not found:
        return None
    try:
        first, *lines = head.decode("ascii").split("\r\n")
        method, path, version = first.split(" ")
        headers = {name.strip().lower(): value.strip() for name, value in (line.split(":", 1) for line in lines)}
        length = int(headers.get("content-length", "0"))
    except ValueError:
        raise RefusedError(400, "no HTTP request") from None
    if not version.startswith("HTTP/1.") or not 0 <= length <= MAX_REQUEST_BYTES:
        raise RefusedError(400, "no HTTP request, or too long a body")
    if len(rest) < length:
        return None
    return Request(method, path, headers, rest[:length].decode("utf-8", "replace"))


def order_of(request: Request, guard: Guard) -> Order | None:
    """Return what a request asks for; None where a browser only asks whether it may.

    The token comes as ``Authorization: Bearer TOKEN``, or as the body's first line: a page then needs no question
    before it, which saves a round trip. The body's next line is the reason.

    Raises
    ------
    RefusedError
        Another page's script, an unknown address or method, or no token.
    """
    origin = request.headers.get("origin")
    if origin is not None and origin not in guard.origins:
        raise RefusedError(403, f"origin {origin[:100]!r} is another site")
    operation = request.path.removeprefix("/")
    if operation not in OPERATIONS:
        raise RefusedError(404, f"there is /{', /'.join(OPERATIONS)}")
    if request.method == "OPTIONS":
        return None
    if request.method != "POST":
        raise RefusedError(405, "send POST")
    kind, _, token = request.headers.get("authorization", "").partition(" ")
    lines = request.body.split("\n")
    if kind.lower() != "bearer":
        token, lines = lines[0], lines[1:]
    if not hmac.compare_digest(token.strip().encode(), guard.token.encode()):
        raise RefusedError(401, "the token is missing or wrong")
    reason = " ".join(lines[0].split())[:200] if lines else ""
    return Order(operation, "".join(c for c in reason if c.isprintable()))


def answer(status: int, content: Mapping[str, Any] | None, origin: str | None = None) -> bytes:
    """Write an answer, which ends the connection; `origin` is the page that may read it."""
    body = b"" if content is None else json.dumps(content, allow_nan=False).encode()
    lines = [f"HTTP/1.1 {status} {_REASONS[status]}", f"Content-Length: {len(body)}", "Connection: close"]
    lines += ["Cache-Control: no-store"]
    if body:
        lines.append("Content-Type: application/json")
    if origin is not None:
        lines += [f"Access-Control-Allow-Origin: {origin}", "Vary: Origin"]
        lines += ["Access-Control-Allow-Methods: POST", "Access-Control-Allow-Headers: authorization, content-type"]
    return ("\r\n".join(lines) + "\r\n\r\n").encode("ascii") + body
