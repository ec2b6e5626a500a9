"""A button that is wired to the cycler, looked at between the ticks of a slow run."""

import time

from bench_service.bench.clock import Clock
from bench_service.bench.stop import StopSignal
from drivers.cycler import Cycler, Reading

_PERIOD_S = 0.015
# Left free before the next tick, and so many times what the slowest question took; one answer that was late is
# forgotten over some ticks.
_ROOM_S, _ROOM_TIMES, _KEPT_PER_TICK = 0.008, 3.0, 0.95


class InputWatch:
    """Asks for the stop input of one run's cycler where there is time before the next tick.

    It asks in turn with the ticks, never beside them: a run whose loop hangs asks nothing.
    """

    def __init__(self, bench: str, cycler: Cycler, stop: StopSignal) -> None:
        self._bench = bench
        self._cycler = cycler
        self._stop = stop
        self._asks = True
        self._room_s = _ROOM_S

    def heed(self, reading: Reading) -> None:
        """Take the button in a sample for a stop; the map says which bit that is."""
        if "stop_input" in reading.status:
            self._pressed()

    def _pressed(self) -> None:
        self._stop.give("stopped", f"the stop input of {self._bench}'s cycler is pressed")

    async def until(self, clock: Clock) -> None:
        """Look every few milliseconds until the next tick is near, or there is an order to stop."""
        self._room_s = max(_ROOM_S, _KEPT_PER_TICK * self._room_s)
        while self._asks and self._stop.order is None and clock.left_s() > _PERIOD_S + self._room_s:
            if await self._stop.wait(_PERIOD_S):
                return
            began_s = time.monotonic()
            pressed = await self._cycler.stop_input()
            self._asks = pressed is not None
            self._room_s = max(self._room_s, _ROOM_TIMES * (time.monotonic() - began_s))
            if pressed:
                self._pressed()
