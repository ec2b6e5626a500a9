"""Driver, safety rules and run loop of a real bench, in one process, in front of an emulated cycler."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bench_service.bench.clock import LockStepClock
from bench_service.bench.limits import Limits
from bench_service.bench.player import make_player
from bench_service.bench.request import RunRequest
from bench_service.bench.run import RunParts, RunPlan
from bench_service.bench.run_loop import RunLoop
from bench_service.bench.safety import Rules
from bench_service.bench.stop import StopSignal
from bench_service.pytest_plugin.background import Background
from bench_service.pytest_plugin.emulated_cycler import EmulatedCycler
from bench_service.pytest_plugin.values import EmulatedCell, EmulatedRun
from bench_service.streams import SAMPLES, STREAMS
from drivers.cycler import Cycler
from drivers.errors import CyclerError
from drivers.factory import open_cycler
from simulators.catalogue import cell_type

_PLAY_TIMEOUT_S = 600.0
_WATCHDOG_S = 1.0


class MemoryRecording:
    """Keeps a run's samples in memory."""

    full = False

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []

    @property
    def n_rows(self) -> int:
        """Samples so far."""
        return len(self.rows)

    def put(self, _stream: str, row: tuple[float, ...]) -> None:
        """Take one sample."""
        self.rows.append(row)


class NoFeed:
    """Nobody watches."""

    due = False

    def note_lateness(self, _lateness_s: float) -> None:
        """Nobody watches."""


class EmulatedBench:
    """A bench with an emulated cycler: driver, safety rules and run loop are those of a real one.

    Attributes
    ----------
    capacity_Ah : float
        Nominal capacity of the cell.
    limits : Limits
        What the cell's data sheet allows; a run may narrow them.
    """

    def __init__(self, background: Background, cycler: EmulatedCycler, cell: EmulatedCell) -> None:
        kind = cell_type(cell.cell)
        self._background, self._cycler, self._cell = background, cycler, cell
        self._soc: float | None = cell.initial_soc
        self.capacity_Ah = kind.parameters.capacity_Ah if cell.capacity_Ah is None else cell.capacity_Ah
        allowed = kind.limits
        self.limits: Limits = Limits(
            allowed.voltage_V, allowed.current_A, allowed.temperature_degC, (0.0, 1.0), None, 14 * 86400.0
        )

    def play(
        self,
        time_s: Sequence[float],
        current_A: Sequence[float],
        *,
        dt_s: float = 1.0,
        settle_s: float = 0.0,
        limits: Limits | None = None,
        timeout_s: float = 0.5,
    ) -> EmulatedRun:
        """Play a profile (forward hold, positive current charges) from rest to rest.

        A limit that is violated, a fault of the device or a lost link is a result, not an exception.
        """
        work = self._played(time_s, current_A, dt_s, settle_s, limits or self.limits, timeout_s)
        return self._background.run(work, _PLAY_TIMEOUT_S)

    async def _played(
        self,
        time_s: Sequence[float],
        current_A: Sequence[float],
        dt_s: float,
        settle_s: float,
        limits: Limits,
        timeout_s: float,
    ) -> EmulatedRun:
        times, currents = np.asarray(time_s, dtype=np.float64), np.asarray(current_A, dtype=np.float64)
        request = RunRequest(
            "emulated", dt_s, limits, self.capacity_Ah, times, currents, settle_s=settle_s, initial_soc=self._soc
        )
        recording, driver = MemoryRecording(), open_cycler(self._cycler.url, self._cycler.map_name, timeout_s)
        try:
            capabilities = await driver.connect()
            plan, parts = _prepared(request, driver, capabilities.current_A, recording, timeout_s)
            end = await RunLoop(plan, parts).play()
            if end.at_rest:
                await driver.release()
        except CyclerError as error:
            return _as_run([], "fault", "connect", str(error), at_rest=False)
        finally:
            await driver.close()
        self._soc = None  # the next run begins where this one ended; only this one counted from a known charge
        return _as_run(recording.rows, end.state, end.code, end.reason, at_rest=end.at_rest)


def _prepared(
    request: RunRequest, driver: Cycler, range_A: tuple[float, float], recording: Any, timeout_s: float
) -> tuple[RunPlan, RunParts]:
    """Build plan and parts of a run in lock-step."""
    tolerance_A = 0.005 * max(abs(value) for value in range_A)
    rules = Rules("emulated bench", request.limits, tolerance_A, 2 * request.dt_s + timeout_s, request.dt_s)
    plan = RunPlan(request, make_player(request.time_s, request.current_A, request.dt_s), rules, _WATCHDOG_S, 1)
    feed: Any = NoFeed()
    return plan, RunParts(driver, LockStepClock(), recording, feed, StopSignal(), None, lambda *_: None)


def _as_run(rows: list[tuple[float, ...]], state: str, code: str, reason: str | None, *, at_rest: bool) -> EmulatedRun:
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(STREAMS[SAMPLES]))
    return EmulatedRun(
        time_s=table[:, 0],
        current_A=table[:, 1],
        voltage_V=table[:, 2],
        temperature_degC=table[:, 3],
        sequence=table[:, 6].astype(np.int64),
        flags=table[:, 7].astype(np.int64),
        state=state,
        code=code,
        reason=reason,
        at_rest=at_rest,
    )
