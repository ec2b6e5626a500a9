"""The cycler of a bench: connected, identified and made safe, or offline with a reason."""

import asyncio
import logging
from collections.abc import Callable

from bench_service.bench.admission import RefusedError
from bench_service.bench.latch import Latch
from bench_service.bench.rest import bring_to_rest
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Capabilities, Cycler, CyclerError, changed_identity
from drivers.factory import open_cycler

_FIRST_RETRY_S = 0.2
_LAST_RETRY_S = 5.0
_CONNECT_TIMEOUT_S = 10.0
_log = logging.getLogger(__name__)
OTHER_DEVICE = "other_device"  # an event's code: the bench waits for a person


class CyclerKeeper:
    """Connects a bench's cycler and lets it go.

    Parameters
    ----------
    settings : BenchSettings
    on_change : callable
        Takes severity, code and text of an event, each time that the cycler has come or gone.

    Attributes
    ----------
    cycler, capabilities
        None while there is none.
    offline_reason : str or None
    retry_s : float
        How long to wait before the next attempt to connect.
    """

    def __init__(self, settings: BenchSettings, on_change: Callable[[str, str, str], None]) -> None:
        self._settings = settings
        self._on_change = on_change
        self.cycler: Cycler | None = None
        self.capabilities: Capabilities | None = None
        self.offline_reason: str | None = "not connected yet"
        self.retry_s = 0.0
        self._identity = settings.identity

    async def connect(self) -> None:
        """Connect, identify, make safe; on failure leave a longer wait before the next attempt."""
        cycler: Cycler | None = None
        try:
            settings = self._settings
            cycler = open_cycler(settings.url, settings.map, settings.timeout_s)
            capabilities = await asyncio.wait_for(cycler.connect(), _CONNECT_TIMEOUT_S)
            if reason := await bring_to_rest(cycler):
                raise CyclerError(f"connected, but rest was not confirmed: {reason}")
            await cycler.sample()  # tells what must not keep a cycler from coming to rest: another master on its bus
        except (CyclerError, TimeoutError) as error:
            if cycler is not None:
                await cycler.close()
            self.retry_s = min(_LAST_RETRY_S, max(_FIRST_RETRY_S, 2 * self.retry_s))
            self._offline(str(error) or "no answer while connecting")
            return
        self.cycler, self.capabilities = cycler, capabilities
        self.offline_reason, self.retry_s = None, 0.0
        known, self._identity = self._identity, capabilities.identity
        if known is not None and (changed := changed_identity(known, capabilities.identity)) is not None:
            text = f"{settings.name}: another cycler than before: {changed}"
            self._on_change("error", OTHER_DEVICE, f"{text}; see that it is the right device, acknowledge")
        self._on_change("info", "connected", f"{capabilities.name} {capabilities.serial} connected, at rest")

    async def disconnect(self, reason: str) -> None:
        """Let the cycler go; the next attempt to connect makes it safe again."""
        if self.cycler is not None:
            await self.cycler.close()
        self.cycler, self.capabilities = None, None
        self._offline(reason)

    async def leave(self) -> None:
        """Bring the cycler to rest and let it go: the process ends."""
        if self.cycler is None:
            return
        if reason := await bring_to_rest(self.cycler):
            _log.error("%s: rest not confirmed at the end: %s", self._settings.name, reason)
        await self.cycler.close()

    async def release(self) -> None:
        """Give the cycler back to its panel after a run; one that does not answer is let go."""
        if self.cycler is None:
            return
        try:
            await self.cycler.release()
        except CyclerError as error:
            await self.disconnect(str(error))

    async def clear_fault(self) -> str | None:
        """Have the cycler's own fault cleared, where there is a cycler; return why it stays, None where it does not."""
        try:
            if self.cycler is not None:
                await self.cycler.clear_fault()
        except CyclerError as error:
            return str(error)
        return None

    def ready(self, latched: Latch | None) -> tuple[Cycler, Capabilities]:
        """Return the cycler for a run.

        Raises
        ------
        RefusedError
            A fault is latched, or there is no cycler.
        """
        if latched is not None:
            raise RefusedError(f"a fault is latched ({latched.text}); acknowledge it first")
        if self.cycler is None or self.capabilities is None:
            raise RefusedError(f"the bench is offline: {self.offline_reason}")
        return self.cycler, self.capabilities

    def _offline(self, reason: str) -> None:
        if reason != self.offline_reason:
            self.offline_reason = reason
            self._on_change("warning", "offline", f"{self._settings.name} is offline: {reason}")
