"""Gives the memory of long bodies back to the system.

A parsed body of 13 MB is a million small objects; the C library keeps what they leave, and a service that runs for
weeks would stay as large as its largest request.
"""

from __future__ import annotations

import asyncio
import ctypes
import ctypes.util
import gc

from starlette.types import ASGIApp, Receive, Scope, Send

LONG_BODY_BYTES = 200_000
_PAUSE_S = 0.2


class GivesBack:
    """ASGI middleware that trims the heap a moment after requests with long bodies.

    Parameters
    ----------
    app : ASGI application
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._trimming: asyncio.Task[None] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let the request through."""
        try:
            await self._app(scope, receive, send)
        finally:
            if scope["type"] == "http" and _length(scope) > LONG_BODY_BYTES and self._trimming is None:
                self._trimming = asyncio.create_task(self._trim())

    async def _trim(self) -> None:
        await asyncio.sleep(_PAUSE_S)
        self._trimming = None
        await asyncio.to_thread(trim_heap)


def trim_heap() -> bool:
    """Return unused memory to the system; False where the C library knows no such call (it is glibc's)."""
    gc.collect()
    library = ctypes.CDLL(ctypes.util.find_library("c") or None)
    trim = getattr(library, "malloc_trim", None)
    return trim is not None and bool(trim(0))


def _length(scope: Scope) -> int:
    for name, value in scope["headers"]:
        if name == b"content-length" and value.isdigit():
            return int(value[:20])
    return 0
