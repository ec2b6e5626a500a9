"""What a run is made of, and how it ends."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

from bench_service.bench.chamber.keeper import ChamberKeeper
from bench_service.bench.clock import Clock
from bench_service.bench.latch import NOT_STORED, Latch
from bench_service.bench.live import LiveFeed
from bench_service.bench.observer_link import ObserverLink
from bench_service.bench.pause import PauseSwitch
from bench_service.bench.plausibility import ExpectedVoltage
from bench_service.bench.player import SetPoints
from bench_service.bench.request import RunRequest
from bench_service.bench.safety import Rules
from bench_service.bench.stop import StopSignal
from drivers.cycler import Cycler


class RowSink(Protocol):
    """Takes what is measured; `bench_service.bench.recording.Recording` in a run."""

    @property
    def n_rows(self) -> int:
        """Number of samples handed in."""
        ...

    @property
    def n_unacknowledged(self) -> int:
        """Number of samples handed in and not yet known to be stored."""
        ...

    @property
    def full(self) -> bool:
        """Whether there is no room for another sample."""
        ...

    def put(self, stream: str, row: tuple[float, ...]) -> None:
        """Take one row; never waits."""
        ...

    async def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until there is room, so long at most; return whether the loop may go on."""
        ...


EndState = Literal["completed", "stopped", "fault", "interrupted"]


@dataclass(frozen=True, slots=True)
class RunEnd:
    """How a run ended.

    Parameters
    ----------
    state : str
    code : str
        Kind of the cause, for programs.
    reason : str or None
        For people; None if the profile was played to its end.
    at_rest : bool
        Whether the cycler has confirmed rest and output off; if not, the device's watchdog must have done it.
    missed_ticks : int
    """

    state: EndState
    code: str
    reason: str | None
    at_rest: bool
    missed_ticks: int

    @property
    def latch(self) -> Latch | None:
        """What has to be acknowledged before the next run; None: nothing."""
        return Latch.of_run(self.state, self.reason)

    def stored(self, n_stored: int, n_played: int, doubt: str) -> "RunEnd":
        """The end of a run that was not sealed: one that has lost samples is not completed, though it was played."""
        if self.state != "completed" or n_stored >= n_played:
            return self
        return replace(self, state="fault", code="recorder", reason=f"{doubt}; the other {NOT_STORED}")


@dataclass(frozen=True, slots=True)
class RunParts:
    """What a run works with.

    Parameters
    ----------
    cycler, clock, recording, feed, stop
    observer : ObserverLink or None
    notify : callable
        Takes severity, code and text of an event.
    pause : PauseSwitch
    chamber : ChamberKeeper or None
    """

    cycler: Cycler
    clock: Clock
    recording: RowSink
    feed: LiveFeed
    stop: StopSignal
    observer: ObserverLink | None
    notify: Callable[[str, str, str], None]
    pause: PauseSwitch = field(default_factory=PauseSwitch)
    chamber: ChamberKeeper | None = None


@dataclass(frozen=True, slots=True)
class RunPlan:
    """What a run does.

    Parameters
    ----------
    request : RunRequest
    player : SetPoints
        A profile, or a protocol, on the grid of ticks.
    rules : Rules
    watchdog_s : float
        To set in the device.
    every : int
        Ticks per recorded sample.
    counted_soc_limits : bool
        Whether limits hold for the counted state of charge. A test that finds the capacity out by its voltage, on a
        bench that allows the whole range, must be free to find more or less than was thought.
    expected : ExpectedVoltage or None
        Of a model, along the profile.
    """

    request: RunRequest
    player: SetPoints
    rules: Rules
    watchdog_s: float
    every: int
    counted_soc_limits: bool = True
    expected: ExpectedVoltage | None = None
