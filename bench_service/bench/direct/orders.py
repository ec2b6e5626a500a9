"""Orders from the stop port, taken over by the control loop."""

from __future__ import annotations

import asyncio
import concurrent.futures
import socket
from collections.abc import Callable, Mapping
from typing import Any

from bench_service.bench.direct.messages import Guard, Order
from bench_service.bench.direct.port import StopPort

_TAKEN_S = 0.5  # in which the loop must have taken an order; else whoever sent it looks for another way

Take = Callable[[Order], Mapping[str, Any]]


class DirectOrders:
    """Wakes the loop with each order and waits in the port's thread until the loop has taken it.

    Parameters
    ----------
    sock : socket.socket or None
        Listens; None: there is no stop port.
    take : callable
        Called in the loop; what it gives is the answer.
    """

    def __init__(self, sock: socket.socket | None, take: Take) -> None:
        self._sock = sock
        self._take = take
        self._port: StopPort | None = None

    def open(self, guard: Guard) -> None:
        """Serve the port from now on; called in the loop, later calls change nothing."""
        sock, self._sock = self._sock, None
        if sock is not None:
            loop = asyncio.get_running_loop()
            self._port = StopPort(sock, guard, lambda order: self._hand_over(loop, order))

    def close(self) -> None:
        """Serve no more."""
        if self._port is not None:
            self._port.close()

    def _hand_over(self, loop: asyncio.AbstractEventLoop, order: Order) -> Mapping[str, Any]:
        taken: concurrent.futures.Future[Mapping[str, Any]] = concurrent.futures.Future()
        try:
            loop.call_soon_threadsafe(lambda: taken.set_result(self._take(order)))
        except RuntimeError:  # the loop has ended, and with it every run
            raise TimeoutError from None
        return taken.result(_TAKEN_S)
