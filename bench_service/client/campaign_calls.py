"""What the REST API offers about campaigns and the queues in which they wait."""

from __future__ import annotations

from collections.abc import Callable

from bench_service.client.connection import API, Connection, Record, part
from bench_service.client.waiting import ENDED_CAMPAIGN_STATES, LOOK_S, Look, wait_until


class CampaignCalls:
    """Part of a `BenchClient`.

    Parameters
    ----------
    connection : Connection
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def start_campaign(self, request: Record) -> Record:
        """Start a campaign; give its record."""
        return self._connection.post(f"{API}/campaigns", request)

    def campaigns(self) -> list[Record]:
        """All campaigns."""
        return self._connection.get(f"{API}/campaigns")["campaigns"]

    def campaign(self, campaign_id: str) -> Record:
        """One campaign."""
        return self._connection.get(f"{API}/campaigns/{part(campaign_id)}")

    def stop_campaign(self, campaign_id: str) -> Record:
        """Stop a campaign and the run that it has started."""
        return self._connection.post(f"{API}/campaigns/{part(campaign_id)}/stop")

    def estimate_campaign(self, request: Record) -> Record:
        """Check a campaign and say how many hours of real time its runs take, without starting it."""
        return self._connection.post(f"{API}/campaigns/estimate", request)

    def queue(self, bench: str) -> Record:
        """Campaigns that wait on a bench, and why they do where nothing goes on by itself."""
        return self._connection.get(f"{API}/benches/{part(bench)}/queue")

    def start_queue(self, bench: str) -> Record:
        """Let a queue go on that waits since a campaign was not completed."""
        return self._connection.post(f"{API}/benches/{part(bench)}/queue/start")

    def resume_campaign(self, campaign_id: str) -> Record:
        """Go on with a campaign that was cut off, from the last stored sample."""
        return self._connection.post(f"{API}/campaigns/{part(campaign_id)}/resume")

    def wait_campaign(
        self,
        campaign_id: str,
        on_progress: Callable[[Record], None] | None = None,
        *,
        timeout_s: float | None = None,
        poll_s: float = LOOK_S,
    ) -> Record:
        """Wait until a campaign has ended and give its record, whatever its end."""
        what = f"campaign {campaign_id}"
        look = Look(what, lambda: self.campaign(campaign_id), ENDED_CAMPAIGN_STATES, on_progress)
        return wait_until(look, timeout_s, poll_s)
