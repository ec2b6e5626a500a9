"""The client's short way to stop a bench: past a service that may be busy, where both are on this machine."""

from __future__ import annotations

from bench_service.client.connection import API, ClientError, Connection, Record, part
from bench_service.stop_tickets import StopTicket, is_local


class StopPorts:
    """Tickets to the stop ports of benches, fetched while the service answers.

    Parameters
    ----------
    url : str
        Of the service; a ticket is of use only on its own machine.
    connection : Connection
    """

    def __init__(self, url: str, connection: Connection) -> None:
        self._local = is_local(url)
        self._connection = connection
        self._tickets: dict[str, StopTicket] = {}

    def learn(self, bench: str) -> None:
        """Get the ticket of a bench, if there is one."""
        if self._local and bench not in self._tickets:
            try:
                told = self._connection.get(f"{API}/benches/{part(bench)}/stop-port")
                self._tickets[bench] = StopTicket(bench, told["url"], told["token"])
            except ClientError:
                return

    def stop(self, bench: str) -> Record | None:
        """Stop a bench; None where that has not worked, and the service is to be asked."""
        ticket = self._tickets.get(bench)
        if ticket is None:
            return None
        try:
            return {"state": ticket.ask("stop", "stopped by a client")["state"]}
        except OSError:
            self._tickets.pop(bench)  # of a service that has ended
            return None
