"""What a control process tells the API, as frames on the command link."""

import math
from dataclasses import asdict
from typing import Any

from bench_service.bench.commissioning.check import Report
from bench_service.bench.latch import Latch
from bench_service.bench.links import FrameLink
from bench_service.bench.messages import EndedMessage, EventMessage, StateMessage
from bench_service.bench.run import RunEnd
from drivers.cycler import Capabilities


class Reporter:
    """Writes messages on a link; never waits.

    Parameters
    ----------
    link : FrameLink
    """

    def __init__(self, link: FrameLink) -> None:
        self._link = link

    def state(
        self,
        state: str,
        reason: str | None,
        run_id: str | None,
        capabilities: Capabilities | None,
        chamber: dict[str, Any] | None = None,
        latched: Latch | None = None,
    ) -> None:
        """Tell the bench's state."""
        message = StateMessage(
            state=state,
            reason=reason,
            run_id=run_id,
            capabilities=None if capabilities is None else _told(capabilities),
            chamber=chamber,
            latch=None if latched is None else latched.code,
        )
        self._link.send({"op": "state", **message})

    def ended(self, run_id: str, end: RunEnd, n_samples: int, sha256: str | None) -> None:
        """Tell the end of a run."""
        counts = {"n_samples": n_samples, "missed_ticks": end.missed_ticks}
        self._send_end(EndedMessage(run_id=run_id, state=end.state, reason=end.reason, sha256=sha256, **counts))

    def refused(self, run_id: str, reason: str) -> None:
        """Tell that a run has not begun."""
        counts = {"n_samples": 0, "missed_ticks": 0, "sha256": None}
        self._send_end(EndedMessage(run_id=run_id, state="fault", reason=reason, **counts))

    def _send_end(self, ended: EndedMessage) -> None:
        self._link.send({"op": "ended", **ended})

    def commissioned(self, report: Report) -> None:
        """Tell what a commissioning has found."""
        self._link.send({"op": "commissioned", "report": report.to_json()})

    def event(self, severity: str, code: str, text: str, run_id: str | None) -> None:
        """Tell people something."""
        message = EventMessage(severity=severity, code=code, text=text, run_id=run_id)
        self._link.send({"op": "event", **message})


def _told(capabilities: Capabilities) -> dict[str, Any]:
    """Return what JSON can hold: None in place of an end of a range that the device's map leaves open."""
    return {
        name: [end if math.isfinite(end) else None for end in value] if isinstance(value, tuple) else value
        for name, value in asdict(capabilities).items()
    }
