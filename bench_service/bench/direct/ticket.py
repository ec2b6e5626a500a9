"""The API process's end of a bench's stop port."""

from __future__ import annotations

import contextlib
import secrets
import socket
from pathlib import Path

from bench_service.stop_tickets import StopTicket, write_ticket

_BACKLOG = 128


class StopEndpoint:
    """Listens before there is a control process, hands that on, and writes down how to use it.

    Attributes
    ----------
    listener : socket.socket
        To be inherited by the control process. Kept open here too, so that a restarted one has the same port.
    ticket : StopTicket
    origins : tuple of str
        Web pages that may read answers.
    """

    def __init__(self, data_dir: Path, bench: str, origins: tuple[str, ...] = ()) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0), backlog=_BACKLOG)
        url = f"http://127.0.0.1:{self.listener.getsockname()[1]}"
        self.ticket = StopTicket(bench, url, secrets.token_urlsafe(24))
        self.origins = origins
        self._file = write_ticket(data_dir, self.ticket)

    def close(self) -> None:
        """Stop listening here and take the ticket away; a control process that still runs keeps its own end."""
        self.listener.close()
        with contextlib.suppress(OSError):
            self._file.unlink()


def own_origins(url: str | None) -> tuple[str, ...]:
    """Return the origins that the service's own page may have, seen from this machine."""
    if url is None:
        return ()
    port = url.rpartition(":")[2]
    return tuple(f"http://{host}:{port}" for host in ("127.0.0.1", "localhost", "[::1]"))
