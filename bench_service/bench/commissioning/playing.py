"""A short run that nobody stores: the same loop, rules and stop as every run, its rows kept in memory."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench_service.bench.commissioning.check import ProofOrder
from bench_service.bench.commissioning.pulses import PulseRow
from bench_service.bench.limits import Limits
from bench_service.bench.live import LiveFeed
from bench_service.bench.request import RunRequest
from bench_service.bench.run import RunEnd, RunParts
from bench_service.bench.run_loop import RunLoop
from bench_service.bench.run_setup import prepare
from bench_service.bench.settings import BenchSettings
from bench_service.bench.stop import StopSignal
from bench_service.streams import SAMPLES, STREAMS
from drivers.cycler import Capabilities, Cycler

_COLUMN = {column.name: k for k, column in enumerate(STREAMS[SAMPLES])}
_ROW = ("time_s", "current_A", "voltage_V", "setpoint_A")


@dataclass(frozen=True, slots=True)
class Stand:
    """What is proved, and with what.

    Parameters
    ----------
    settings, cycler, capabilities, order
    limits : Limits
        Within which current may flow.
    tick_s : float
        Period of samples and set-points.
    feed, stop
        Of the control process.
    notify : callable
        Takes severity, code and text.
    """

    settings: BenchSettings
    cycler: Cycler
    capabilities: Capabilities
    order: ProofOrder
    limits: Limits
    tick_s: float
    feed: LiveFeed
    stop: StopSignal
    notify: Callable[[str, str, str], None]

    @property
    def period_s(self) -> float | None:
        """Of lock-step; None on the wall clock."""
        return self.tick_s if self.capabilities.lock_step else None


class RowsInMemory:
    """Takes what a run records.

    Parameters
    ----------
    on_row : callable
        Takes the row that has just come.
    """

    full = False
    n_unacknowledged = 0

    def __init__(self, on_row: Callable[[PulseRow], None]) -> None:
        self.rows: list[PulseRow] = []
        self._on_row = on_row

    @property
    def n_rows(self) -> int:
        """Number of samples handed in."""
        return len(self.rows)

    def put(self, stream: str, row: tuple[float, ...]) -> None:
        """Take one row."""
        if stream == SAMPLES:
            self.rows.append(PulseRow(*(row[_COLUMN[name]] for name in _ROW)))
            self._on_row(self.rows[-1])

    async def wait_for_room(self, timeout_s: float) -> bool:
        """There is always room."""
        return True


@dataclass(frozen=True, slots=True)
class Played:
    """A short run: how it ended, what it measured, and how long after the order to stop it was at rest."""

    end: RunEnd
    rows: list[PulseRow]
    stopped_s: float | None


async def play(
    stand: Stand,
    time_s: Sequence[float],
    current_A: Sequence[float],
    stop_when: Callable[[PulseRow], bool] | None = None,
) -> Played:
    """Play a profile, to its end or until `stop_when` says so of a row.

    Raises
    ------
    RefusedError
        It must not be played.
    """
    request = RunRequest(
        run_id="",
        dt_s=stand.tick_s,
        limits=stand.limits,
        capacity_Ah=stand.settings.capacity_Ah,
        time_s=np.asarray(time_s, float),
        current_A=np.asarray(current_A, float),
        settle_s=stand.order.settle_s,
    )
    prepared = await prepare(replace(stand.settings, limits=stand.limits), stand.capabilities, request)
    stop, ordered_s = StopSignal(), list[float]()

    def seen(row: PulseRow) -> None:
        if stop_when is not None and not ordered_s and stop_when(row):
            ordered_s.append(time.monotonic())
            stop.give("stopped", "stop is proved")

    def passed_on() -> None:
        if (order := stand.stop.order) is not None:
            stop.give(order.state, order.reason)

    stop.on_order(prepared.clock.interrupt)
    stand.stop.on_order(passed_on)
    memory = RowsInMemory(seen)
    parts = RunParts(stand.cycler, prepared.clock, memory, stand.feed, stop, None, stand.notify)
    with prepared.environment(stand.notify):
        end = await RunLoop(prepared.plan, parts).play()
        rest_s = time.monotonic()
    return Played(end, memory.rows, rest_s - ordered_s[0] if ordered_s else None)
