"""Starts what was cut off, as soon as bench, recorder and disk are back; a fault that takes a person waits for one."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from bench_service.campaign.benches import Benches
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.starting import Start
from bench_service.campaign.workshop import CampaignStoppedError
from bench_service.errors import BenchBusyError, BenchOfflineError, StoreError
from bench_service.store.records import RunRecord

_TRY_S = 0.5


async def start_again(
    benches: Benches,
    order: RunOrder,
    waiting: Start,
    start: Callable[[RunOrder], Awaitable[RunRecord]],
    say: Callable[[str, bool], object],
    *,
    declared: frozenset[str],
    timeout_s: float,
) -> RunRecord:
    """Try to start a run until it is, so long at most.

    Parameters
    ----------
    benches, order
    waiting : Start
        Of the bench; a person who stops that while this waits has stopped what waits.
    start : callable
        Starts it, or raises.
    say : callable
        Takes what is waited for, in words, and whether that is a person, at each try.
    declared : frozenset of str
        Codes of the latches that are acknowledged here, since whoever gave the order has declared so before.
    timeout_s : float

    Raises
    ------
    CampaignStoppedError
        The bench was stopped meanwhile.
    BenchBusyError, BenchOfflineError, StoreError
        It could not be started in that time.
    """
    deadline_s = asyncio.get_running_loop().time() + timeout_s
    while waiting.stop is None:
        status = benches.get(order.bench).supervisor.status
        if (latched := status.latched) is not None and latched.code not in declared:
            say(f"waits for a person, goes on when bench {order.bench!r} is acknowledged: {latched.text}", True)
        else:
            say(f"goes on as soon as bench {order.bench!r} is ready: {status.reason or 'now'}", False)
            await benches.acknowledge(order.bench)
        try:
            return await start(order)
        except (BenchBusyError, BenchOfflineError, StoreError):
            if asyncio.get_running_loop().time() > deadline_s:
                raise
        await asyncio.sleep(_TRY_S)
    raise CampaignStoppedError(f"stopped while it waited for bench {order.bench!r}: {waiting.stop}")
