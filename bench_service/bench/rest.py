"""Bringing a cycler to rest, whatever happens meanwhile."""

import asyncio
import contextlib
from collections.abc import Coroutine
from typing import Any, TypeVar

from drivers.cycler import Cycler

_REST_ATTEMPTS = 2
_REST_TIMEOUT_S = 2.0

T = TypeVar("T")


async def bring_to_rest(cycler: Cycler) -> str | None:
    """Bring the cycler to rest with its output off.

    Returns
    -------
    None when the cycler has confirmed it, else why not.
    """
    reason = None
    for _ in range(_REST_ATTEMPTS):
        try:
            await asyncio.wait_for(cycler.safe(), _REST_TIMEOUT_S)
        except Exception as error:  # whatever went wrong, the next attempt may succeed
            reason = str(error) or repr(error)
        else:
            return None
    return reason


async def woken(event: asyncio.Event, seconds: float) -> bool:
    """Wait so long, or until an event has come; return whether it has."""
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(event.wait(), seconds)
    return event.is_set()


async def uncancelled(work: Coroutine[Any, Any, T]) -> T:
    """Finish `work` even if the caller is cancelled meanwhile; the cancellation is passed on afterwards."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is not None:
        raise cancelled
    return task.result()
