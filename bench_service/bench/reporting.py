"""What a control process tells the API, as frames on the command link."""

from dataclasses import asdict

from bench_service.bench.links import FrameLink
from bench_service.bench.messages import EndedMessage, EventMessage, StateMessage
from drivers.cycler import Capabilities


class Reporter:
    """Writes messages on a link; never waits.

    Parameters
    ----------
    link : FrameLink
    """

    def __init__(self, link: FrameLink) -> None:
        self._link = link

    def state(self, state: str, reason: str | None, run_id: str | None, capabilities: Capabilities | None) -> None:
        """Tell the bench's state."""
        message = StateMessage(
            state=state,
            reason=reason,
            run_id=run_id,
            capabilities=None if capabilities is None else asdict(capabilities),
        )
        self._link.send({"op": "state", **message})

    def ended(self, ended: EndedMessage) -> None:
        """Tell the end of a run."""
        self._link.send({"op": "ended", **ended})

    def event(self, severity: str, code: str, text: str, run_id: str | None) -> None:
        """Tell people something."""
        message = EventMessage(severity=severity, code=code, text=text, run_id=run_id)
        self._link.send({"op": "event", **message})
