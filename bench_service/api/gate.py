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
    """

    def __init__(self, app: ASGIApp, host: str) -> None:
        self._app = app
        self._all_addresses = host in _WILDCARDS
        own = {socket.gethostname().lower()} if self._all_addresses else {host.lower().strip("[]")}
        self._names = _LOCAL_NAMES | own

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let the request through, or answer 403."""
        refusal = self._refusal(scope) if scope["type"] in ("http", "websocket") else None
        if refusal is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            await error_response(403, "forbidden", refusal)(scope, receive, send)
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
