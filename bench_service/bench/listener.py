"""What is known of a bench in the API process, and who hears of it."""

from dataclasses import dataclass
from typing import Any, Protocol, Self

from bench_service.bench.latch import Latch
from bench_service.bench.messages import EndedMessage, EventMessage, LiveMessage
from drivers.cycler import IDENTITY


@dataclass(frozen=True, slots=True)
class BenchStatus:
    """What is known of a bench.

    Parameters
    ----------
    state : str
        ``offline``, ``idle``, ``running``, ``paused``, ``stopping`` or ``fault``.
    reason : str or None
    run_id : str or None
    capabilities : dict or None
        Of the connected cycler; see `drivers.cycler.Capabilities`.
    chamber : dict or None
        What is known of the temperature chamber; None where there is none.
    latch : str or None
        Code of what is latched, see `bench_service.bench.latch`; None where nothing is.
    """

    state: str
    reason: str | None = None
    run_id: str | None = None
    capabilities: dict[str, Any] | None = None
    chamber: dict[str, Any] | None = None
    latch: str | None = None

    @classmethod
    def in_fault(cls, latched: Latch) -> Self:
        """Return the state of a bench of which nothing is known but what is latched."""
        return cls("fault", latched.text, latch=latched.code)

    @property
    def latched(self) -> Latch | None:
        """What has to be acknowledged; None where nothing is."""
        if self.state != "fault":
            return None
        return Latch(self.latch or "unknown", self.reason or "a fault without a reason")

    @property
    def identity(self) -> dict[str, str] | None:
        """What the connected cycler says of itself; None where there is none."""
        return None if self.capabilities is None else {key: self.capabilities.get(key, "") for key in IDENTITY}


class BenchListener(Protocol):
    """Told what happens on a bench, in the event loop of the API; must not block and not raise."""

    def on_state(self, bench: str, status: BenchStatus) -> None:
        """Take a new state."""
        ...

    def on_live(self, bench: str, live: LiveMessage) -> None:
        """Take a live sample."""
        ...

    def on_event(self, bench: str, event: EventMessage) -> None:
        """Take an event."""
        ...

    def on_ended(self, bench: str, ended: EndedMessage) -> None:
        """Take the end of a run.

        Called exactly once for each run that `BenchSupervisor.start_run` accepted. State ``interrupted`` with
        ``n_samples`` None: the control process died, and the recorder knows what is stored.
        """
        ...
