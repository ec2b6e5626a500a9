"""How long tests wait before they say that something does not happen.

A test waits for a state, not for seconds: it goes on as soon as the state is there, so that patience costs nothing on
a quiet machine and must outlast a busy one. `BENCH_TEST_PATIENCE=3` makes every test three times as patient.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable
from typing import Any

FACTOR = float(os.environ.get("BENCH_TEST_PATIENCE", "1"))
PATIENCE_S = 120.0 * FACTOR  # for what takes a second or two
LONG_S = 1200.0 * FACTOR  # for a campaign, a fit, a diagnosis
_BURST_S = 0.05


def wait_for(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S, every_s: float = 0.01) -> Any:
    """Look until `condition` holds; returns what it gave."""
    until_s = time.monotonic() + patience_s
    while not (found := condition()):
        assert time.monotonic() < until_s, f"not within {patience_s:g} s: {what}"
        time.sleep(every_s)
    return found


async def holds(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S, every_s: float = 0.005) -> Any:
    """Let the event loop run until `condition` holds; returns what it gave."""
    until_s = time.monotonic() + patience_s
    while not (found := condition()):
        assert time.monotonic() < until_s, f"not within {patience_s:g} s: {what}"
        await asyncio.sleep(every_s)
    return found


def stretched(quiet_s: float) -> float:
    """What a time on a quiet machine may become on this one, now.

    A short burst of work tells which share of a processor a process gets here; the time is stretched by twice its
    inverse, because the burst sees one moment only.
    """
    wall_s, work_s = time.perf_counter(), time.process_time()
    while time.process_time() - work_s < _BURST_S:
        pass
    return FACTOR * quiet_s * max(1.0, 2.0 * (time.perf_counter() - wall_s) / _BURST_S - 1.0)
