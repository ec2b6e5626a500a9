"""The order to end a run, given from outside the loop."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from bench_service.bench.rest import woken

StopState = Literal["stopped", "interrupted", "fault"]


@dataclass(frozen=True, slots=True)
class StopOrder:
    """How a run is to be closed, and why."""

    state: StopState
    reason: str


class StopSignal:
    """Holds the first stop order and wakes the loop wherever it waits."""

    def __init__(self) -> None:
        self.order: StopOrder | None = None
        self._wake: list[Callable[[], None]] = []

    def on_order(self, *wakes: Callable[[], None]) -> None:
        """Have `wakes` called when the order comes; at once if it has come already."""
        self._wake.extend(wakes)
        if self.order is not None:
            for wake in wakes:
                wake()

    async def wait(self, seconds: float) -> bool:
        """Wait so long, or until there is an order; return whether there is one."""
        ordered = asyncio.Event()
        self.on_order(ordered.set)
        try:
            return await woken(ordered, seconds)
        finally:
            self._wake.remove(ordered.set)

    def give(self, state: StopState, reason: str) -> None:
        """Order the run to end; later orders do not replace the first."""
        if self.order is None:
            self.order = StopOrder(state, reason)
            for wake in self._wake:
                wake()
