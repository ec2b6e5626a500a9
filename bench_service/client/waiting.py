"""How the Python client waits for the end of a run, a job or a campaign."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypedDict

from bench_service.client.connection import ClientError, Record

LOOK_S = 0.2
ENDED_RUN_STATES = frozenset({"completed", "stopped", "fault", "interrupted"})
ENDED_CAMPAIGN_STATES = frozenset({"completed", "failed", "stopped", "interrupted"})
ENDED_JOB_STATES = frozenset({"done", "failed"})
# How a wait passes the time until its next look; who waits for several things at a time puts another way in its place.
PAUSE: ContextVar[Callable[[float], None] | None] = ContextVar("PAUSE", default=None)
# Within one wait the service may be restarted; longer silence is an error.
_LONGEST_SILENCE_S = 30.0


class Cancelled(Exception):  # noqa: N818  # no error: nobody waits any more
    """Nobody waits for what a wait would see."""


class Patience(TypedDict, total=False):
    """How a job is waited for.

    ``on_progress`` is called with the job's record at each look; after ``timeout_s`` the wait ends with a
    `ClientError`, and the job goes on.
    """

    on_progress: Callable[[Record], None] | None
    timeout_s: float | None


@dataclass(frozen=True, slots=True)
class Look:
    """Looking at something until it has ended.

    Parameters
    ----------
    what : str
        Its name in messages.
    see : callable
        Gives its record.
    ended_states : set of str
    tell : callable or None
        Gets the record at each look.
    """

    what: str
    see: Callable[[], Record]
    ended_states: frozenset[str]
    tell: Callable[[Record], None] | None


def wait_until(look: Look, timeout_s: float | None, poll_s: float) -> Record:
    """Look every `poll_s` until it has ended, and give what was seen; raises `ClientError` after `timeout_s`."""
    start_s = heard_s = time.monotonic()
    while True:
        try:
            record = look.see()
            if look.tell is not None:
                look.tell(record)
            heard_s = time.monotonic()
            if record["state"] in look.ended_states:
                return record
        except ClientError as error:
            if error.status is not None or time.monotonic() - heard_s > _LONGEST_SILENCE_S:
                raise
        if timeout_s is not None and time.monotonic() - start_s > timeout_s:
            raise ClientError(f"{look.what} has not ended within {timeout_s:g} s; it goes on", code="timeout")
        (PAUSE.get() or time.sleep)(poll_s)
