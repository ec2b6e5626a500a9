"""Turns away requests that a foreign web page makes its visitor's browser send.

DNS rebinding shows in the Host header, other sites' scripts in the Origin header; CORS covers neither for WebSockets
and forms.
"""

from __future__ import annotations

import ipaddress
import socket
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from bench_service.api.access import LOGIN, Access
from bench_service.api.errors import error_response

_LOCAL_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
_WILDCARDS = frozenset({"0.0.0.0", "::", ""})  # noqa: S104  # compared with, not bound to
_SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
_WS_POLICY_VIOLATION = 1008


class Gate:
    """ASGI middleware that checks Host, and Origin where a request changes something or opens a WebSocket.

    Parameters
    ----------
    app : ASGI application
    host : str
        Name or address that the service is bound to. Bound to all addresses, it also answers to this machine's
        name and to any address written as numbers: only names can be rebound.
    token : str or None
        That every request must carry; None: no token is needed.
    """

    def __init__(self, app: ASGIApp, host: str, token: str | None = None) -> None:
        self._app = app
        self._access = None if token is None else Access(token)
        self._all_addresses = host in _WILDCARDS
        own = {socket.gethostname().lower()} if self._all_addresses else {host.lower().strip("[]")}
        self._names = _LOCAL_NAMES | own

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let the request through, or answer 403, or 401 where the token is missing."""
        status, code = 403, "forbidden"
        refusal = self._refusal(scope) if scope["type"] in ("http", "websocket") else None
        if refusal is None and self._access is not None and scope["type"] in ("http", "websocket"):
            if scope["type"] == "http" and scope["path"] == LOGIN and scope["method"] == "GET":
                await self._access.login(scope)(scope, receive, send)
                return
            status, code, refusal = 401, "unauthorized", self._access.refusal(scope)
        if refusal is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            await error_response(status, code, refusal)(scope, receive, send)
        else:  # closing before accepting is answered with HTTP 403
            await send({"type": "websocket.close", "code": _WS_POLICY_VIOLATION, "reason": refusal[:120]})

    def _refusal(self, scope: Scope) -> str | None:
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            shown = (hosts[0] if hosts else "none")[:100]
            return f"host {shown!r} is not this service's; use the address that it printed at its start"
        changes = scope["type"] == "websocket" or scope["method"] not in _SAFE_METHODS
        for origin in headers.getlist("origin") if changes else ():
            if _netloc(origin) != hosts[0].lower():
                return f"origin {origin[:100]!r} is another site; open the page of this service itself"
        return None

    def _is_own(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname
        except ValueError:
            return False
        return name is not None and (name in self._names or (self._all_addresses and _is_address(name)))


def _netloc(origin: str) -> str:
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
