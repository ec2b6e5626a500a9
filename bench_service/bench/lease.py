"""How long a bench plays on when the service has fallen silent: a stopped process closes no link."""

import asyncio
import time
from collections.abc import Callable

_LOOK_S = 0.5


class Lease:
    """Renewed by every word of the service; watched by the control loop itself.

    Parameters
    ----------
    on_lost : callable
        Called with the silence, in s, once each time that the lease has run out.
    lease_s : float
    monotonic : callable
    """

    def __init__(
        self,
        on_lost: Callable[[float], None],
        lease_s: float,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._on_lost = on_lost
        self._lease_s = lease_s
        self._monotonic = monotonic
        self._heard_s = monotonic()
        self._lost = False
        self._timer: asyncio.TimerHandle | None = None

    def renew(self) -> None:
        """Note that the service has said something."""
        self._heard_s = self._monotonic()
        self._lost = False

    def watch(self) -> None:
        """Look now, and again and again until `close`."""
        silent_s = self._monotonic() - self._heard_s
        if silent_s > self._lease_s and not self._lost:
            self._lost = True
            self._on_lost(silent_s)
        self._timer = asyncio.get_running_loop().call_later(_LOOK_S, self.watch)

    def close(self) -> None:
        """Look no more."""
        if self._timer is not None:
            self._timer.cancel()
