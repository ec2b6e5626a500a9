"""A run that somebody holds: output off, the profile waits; on the wall clock its samples go on, and are marked."""

import asyncio

from bench_service.bench.clock import Tick
from bench_service.bench.run import RunParts

_LOOK_S = 0.1


class Holding:
    """Where the profile stands.

    Parameters
    ----------
    bench : str
        Name for the messages.
    parts : RunParts
    """

    def __init__(self, bench: str, parts: RunParts) -> None:
        self._bench = bench
        self._parts = parts
        self._held = 0  # ticks, in the pauses that are over
        self._from = 0  # where the profile waits

    @property
    def active(self) -> bool:
        """Whether the run is held now."""
        return self._parts.pause.active

    @property
    def begins(self) -> bool:
        """Whether `follow` is about to hold the run."""
        pause = self._parts.pause
        return pause.wanted and not pause.active and self._parts.stop.order is None

    def position(self, tick: Tick) -> int:
        """Return the profile's own tick."""
        return self._from if self.active else tick.index - self._held

    async def follow(self, tick: Tick) -> bool:
        """Hold the run, or go on with it, where somebody wants that; return whether something has changed.

        In lock-step simulated time stands still for as long as the run is held, and this returns when it goes on.
        """
        pause = self._parts.pause
        if pause.wanted == pause.active or self._parts.stop.order is not None:
            return False
        if pause.wanted:
            await self._hold(tick)
            if self._parts.clock.lock_step:
                await self._stand_still()
        if not pause.wanted and self._parts.stop.order is None:
            await self._go_on(tick)
        return True

    async def _hold(self, tick: Tick) -> None:
        position = self.position(tick)
        await self._parts.cycler.output(False)
        self._from = position
        self._tell(tick, "warning", "paused", "the run is paused, output off")
        self._parts.pause.note(active=True)

    async def _go_on(self, tick: Tick) -> None:
        self._held = tick.index - self._from
        await self._parts.cycler.output(True)
        self._tell(tick, "info", "resumed", "the run goes on")
        self._parts.pause.note(active=False)

    async def _stand_still(self) -> None:
        while self._parts.pause.wanted and self._parts.stop.order is None:
            await self._parts.cycler.sample()  # a simulator takes a silent client for a dead one
            await asyncio.sleep(_LOOK_S)

    def _tell(self, tick: Tick, severity: str, code: str, text: str) -> None:
        self._parts.notify(severity, code, f"{self._bench} at {self._parts.clock.elapsed_s(tick):.3f} s: {text}")
