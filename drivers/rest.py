"""How every driver comes to rest, and how it sees that the device did as it was told."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable, Mapping
from typing import Protocol

from drivers.cycler import Reading, changed_identity
from drivers.errors import CyclerConnectionError, CyclerError, CyclerProtocolError

OUTPUT_SETTLE_S = 0.5  # a contactor takes its time; a bench must be at rest within 2 s
POLL_S = 0.01
REOPEN_ATTEMPTS = 2  # per `come_to_rest`: each may take as long as a connect
Step = Callable[[], Awaitable[None]]


class Link(Protocol):
    """What is needed of a transport."""

    address: str

    @property
    def is_open(self) -> bool:
        """Whether the link is there, as far as this side knows."""
        ...


async def come_to_rest(link: Link, steps: Iterable[Step], reopen: Step) -> None:
    """Take every step towards rest, whatever became of the others; twice where the link had to be opened again.

    Commanding rest twice does no harm.

    Raises
    ------
    CyclerError
        Of the kind of the first step that failed, with what was wrong with each.
    """
    errors: list[CyclerError] = []
    attempts = REOPEN_ATTEMPTS
    for step in steps:
        for last in (False, True):
            try:
                if not link.is_open:
                    if not attempts:
                        raise CyclerConnectionError(f"{link.address}: not connected")
                    attempts -= 1
                    await reopen()
                await step()
                break
            except CyclerError as error:
                if last or link.is_open:  # what the device refuses it will refuse again
                    errors.append(error)
                    break
    if errors:
        text = "; ".join(dict.fromkeys(str(error) for error in errors))
        raise type(errors[0])(f"not verified to be at rest: {text}") from errors[0]


async def wait_for_output(address: str, sample: Callable[[], Awaitable[Reading]], *, on: bool) -> None:
    """Wait until the status says what the output was told.

    Raises
    ------
    CyclerProtocolError
        If it says otherwise for `OUTPUT_SETTLE_S`.
    """
    deadline_s = time.monotonic() + OUTPUT_SETTLE_S
    while True:
        reading = await sample()
        if reading.output_on == on:
            return
        if time.monotonic() >= deadline_s:
            told, alarms = ("on" if on else "off"), ", ".join(sorted(reading.alarms)) or "none"
            raise CyclerProtocolError(
                f"{address}: output was switched {told}, but the status says otherwise after "
                f"{OUTPUT_SETTLE_S:g} s; alarms: {alarms}"
            )
        await asyncio.sleep(POLL_S)


def check_same(address: str, before: Mapping[str, str], now: Mapping[str, str]) -> None:
    """See that a link that was opened again leads to the device that it led to before.

    Raises
    ------
    CyclerProtocolError
        Naming what is different.
    """
    if changed := changed_identity(before, now):
        raise CyclerProtocolError(f"{address}: another device answers at this address: {changed}; nothing was written")


def check_cleared(address: str, reading: Reading) -> None:
    """See that no alarm is left after clearing.

    Raises
    ------
    CyclerProtocolError
        Naming those that stay.
    """
    if reading.alarms:
        raise CyclerProtocolError(
            f"{address}: alarms stay after clearing: {', '.join(sorted(reading.alarms))}; remove their cause first"
        )
