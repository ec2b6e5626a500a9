"""Serves the stop port: a thread of its own, which neither the control loop nor any client can hold up."""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from bench_service.bench.direct.messages import Guard, Order, RefusedError, Request, answer, order_of, read_request

# Whoever opens connections and sends nothing loses the oldest of them to the next one that comes.
MOST_CONNECTIONS = 32
PATIENCE_S = 2.0
_RECEIVE_BYTES = 8192
_ABOVE_THE_LOOP = 11  # real-time priority, where the system allows it: just over that of a run
# Takes an order, gives what became of it; called in the port's thread.
Obey = Callable[[Order], Mapping[str, Any]]


class StopPort:
    """Serves one listening socket until `close`.

    Parameters
    ----------
    listener : socket.socket
        Bound to a loopback address and listening; owned by the port from now on.
    guard : Guard
    obey : callable
        Called in the port's thread with each order; what it returns is the answer. `TimeoutError` means that the
        control loop has not answered.
    """

    def __init__(self, listener: socket.socket, guard: Guard, obey: Obey) -> None:
        listener.setblocking(False)
        self._listener, self._guard, self._obey = listener, guard, obey
        self._open: dict[socket.socket, tuple[float, bytes]] = {}  # oldest first
        self._selector = selectors.DefaultSelector()
        self._selector.register(listener, selectors.EVENT_READ)
        self._wake, self._woken = socket.socketpair()
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._serve, name="stop port", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close every connection."""
        with contextlib.suppress(OSError):
            self._wake.send(b"x")
        self._thread.join(PATIENCE_S)
        self._wake.close()

    # --- the port's thread ---------------------------------------------------------------------------------

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_ABOVE_THE_LOOP))
        while True:
            ready = {key.fileobj for key, _ in self._selector.select(PATIENCE_S if self._open else None)}
            if self._woken in ready:
                break
            for sock in [sock for sock in self._open if sock in ready]:
                self._receive(sock)
            if self._listener in ready:
                self._accept()
            self._end_the_silent()
        for sock in (*self._open, self._listener, self._woken):
            sock.close()
        self._selector.close()

    def _accept(self) -> None:
        try:
            sock, _ = self._listener.accept()
        except OSError:
            return
        if len(self._open) >= MOST_CONNECTIONS:
            self._end(next(iter(self._open)))
        sock.setblocking(False)
        self._open[sock] = time.monotonic(), b""
        self._selector.register(sock, selectors.EVENT_READ)
        self._receive(sock)  # what is asked has often come with the connection

    def _receive(self, sock: socket.socket) -> None:
        since_s, data = self._open[sock]
        try:
            more = sock.recv(_RECEIVE_BYTES)
        except BlockingIOError:
            return
        except OSError:
            more = b""
        self._open[sock] = since_s, data + more
        if not more:
            self._end(sock)
        elif (reply := self._reply(data + more)) is not None:
            with contextlib.suppress(OSError):
                sock.send(reply)  # smaller than any socket's buffer
            self._end(sock)

    def _reply(self, data: bytes) -> bytes | None:
        request: Request | None = None
        try:
            request = read_request(data)
            if request is None:
                return None
            order = order_of(request, self._guard)
            if order is None:
                return answer(204, None, self._reader(request))
            return answer(200, self._obey(order), self._reader(request))
        except RefusedError as error:
            return answer(error.status, {"error": str(error)}, self._reader(request))
        except TimeoutError:
            return answer(503, {"error": "the control loop has not answered"}, self._reader(request))

    def _reader(self, request: Request | None) -> str | None:
        origin = None if request is None else request.headers.get("origin")
        return origin if origin in self._guard.origins else None

    def _end_the_silent(self) -> None:
        old = time.monotonic() - PATIENCE_S
        for sock in [sock for sock, (since_s, _) in self._open.items() if since_s < old]:
            self._end(sock)

    def _end(self, sock: socket.socket) -> None:
        self._open.pop(sock, None)
        self._selector.unregister(sock)
        sock.close()
