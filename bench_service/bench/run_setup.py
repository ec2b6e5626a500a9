"""From a request to everything a run needs; all that takes time happens here, before the output is on."""

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from bench_service.bench.admission import RefusedError, check_start, ticks_per_sample
from bench_service.bench.clock import Clock, LockStepClock, WallClock
from bench_service.bench.limits import Limits
from bench_service.bench.observer_link import ObserverError, ObserverLink
from bench_service.bench.plausibility import ExpectedVoltage
from bench_service.bench.player import SetPoints, make_player
from bench_service.bench.protocol_play import ProtocolPlay
from bench_service.bench.protocol_window import soc_window, window_of
from bench_service.bench.realtime import no_garbage_collection, real_time_priority
from bench_service.bench.recording import queue_rows
from bench_service.bench.request import RunRequest
from bench_service.bench.run import RunPlan
from bench_service.bench.safety import Rules
from bench_service.bench.settings import BenchSettings
from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.document import read_protocol
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.state import Standing
from bench_service.streams import OBSERVER, SAMPLES, STEPS
from drivers.cycler import Capabilities

_DEFAULT_TOLERANCE = 0.005  # share of the range
_BEST_ACCURACY = 0.0005
_SHARE_OF_LIMITS = 0.1
_TICKS_OF_AGE = 2

Note = tuple[str, str, str]


@dataclass(frozen=True, slots=True)
class PreparedRun:
    """A run that may start.

    Parameters
    ----------
    plan : RunPlan
    clock : Clock
    observer : ObserverLink or None
    streams : tuple of str
        To be recorded.
    queue_rows : int
        Samples that may wait for the recorder.
    notes : tuple of (severity, code, text)
        What the people should know.
    """

    plan: RunPlan
    clock: Clock
    observer: ObserverLink | None
    streams: tuple[str, ...]
    queue_rows: int
    notes: tuple[Note, ...]

    @contextlib.contextmanager
    def environment(self, notify: Callable[[str, str, str], None]) -> Iterator[None]:
        """Make the process punctual for the time of the run; tells where the system does not allow it."""
        with contextlib.ExitStack() as stack:
            stack.enter_context(no_garbage_collection())
            if not self.clock.lock_step and (reason := stack.enter_context(real_time_priority())):
                notify("warning", "priority", reason)
            yield


async def prepare(settings: BenchSettings, capabilities: Capabilities, request: RunRequest) -> PreparedRun:
    """Check a request and build what its run needs.

    Raises
    ------
    RefusedError
        The run must not start.
    """
    lock_step = capabilities.lock_step if settings.lock_step is None else settings.lock_step
    try:
        every = ticks_per_sample(request.dt_s, settings.watchdog_s, lock_step)
        player = _set_points(settings, capabilities, request, every)
        # The first step compiles; that must not happen with the output on.
        observer = await asyncio.to_thread(build_observer, request)
        expected = await asyncio.to_thread(_expected, request)
    except (ValueError, ObserverError, ProtocolError) as error:
        raise RefusedError(str(error)) from error
    return PreparedRun(
        plan=RunPlan(
            request,
            player,
            _rules(settings, capabilities, request, player.dt_s),
            settings.watchdog_s,
            every,
            counted_soc_limits=request.protocol is None or soc_window(request.limits) is not None,
            expected=expected,
        ),
        clock=LockStepClock() if lock_step else WallClock(),
        observer=observer,
        streams=(SAMPLES, *((OBSERVER,) if observer else ()), *((STEPS,) if request.protocol else ())),
        # A protocol may store every tick, a profile its samples.
        queue_rows=queue_rows(player.dt_s if player.closed_loop else request.dt_s, lock_step),
        notes=tuple(_notes(settings, request, player.skipped_points)),
    )


def _set_points(settings: BenchSettings, capabilities: Capabilities, request: RunRequest, every: int) -> SetPoints:
    if request.protocol is None:
        player = make_player(request.time_s, request.current_A, request.dt_s / every)
        check_start(settings, capabilities, request, player)
        return player
    check_start(settings, capabilities, request)
    order = request.protocol
    known = {"soc_known": request.initial_soc is not None, "chamber": settings.chamber and settings.chamber.window}
    window = window_of(request.limits, capabilities.current_A, **known)
    program = compile_protocol(read_protocol(order["document"]), request.capacity_Ah, window)
    standing = None if order["standing"] is None else Standing.from_json(order["standing"])
    return ProtocolPlay(
        program, request.dt_s / every, standing, order["expected_s"], device_holds=capabilities.has_hold
    )


def build_observer(request: RunRequest) -> ObserverLink | None:
    """Build the observer that a request asks for, compiled and at its initial state; None if it asks for none.

    Raises
    ------
    ObserverError
        The model cannot be used with an observer, or not at the run's period.
    """
    if request.observer is None:
        return None
    # Lazy: the observer, with the compiler, takes 1.2 s, longer than all else that a control process does at its start.
    from bench_service.bench.fuzzy_observer_link import fuzzy_link

    return fuzzy_link(request, request.observer)


def _expected(request: RunRequest) -> ExpectedVoltage | None:
    if request.band is None:
        return None
    # Lazy: as the observer.
    from bench_service.bench.model_band import expected_voltage

    try:
        return expected_voltage(request, request.band)
    except Exception as error:  # whatever a model does, it is a reason not to start
        raise RefusedError(f"the model's band cannot be computed: {error}") from error


def _rules(settings: BenchSettings, capabilities: Capabilities, request: RunRequest, tick_s: float) -> Rules:
    return Rules(
        bench=settings.name,
        limits=request.limits,
        current_tolerance_A=tolerance_A(settings, capabilities, request.limits),
        max_age_s=_TICKS_OF_AGE * tick_s + settings.timeout_s,
        tick_s=tick_s,
        stale_limit=request.stale_limit,
        has_sequence=capabilities.has_sequence,
        resistance_Ohm=settings.resistance_Ohm,
    )


def tolerance_A(settings: BenchSettings, capabilities: Capabilities, limits: Limits) -> float:
    """Return how far measured and commanded current may lie apart.

    What a device of that range may be off by, but no more than a share of the run's own limits: half a percent of
    30 A is three times what a run of 0.05 A may have. Below the accuracy of good devices nothing is asked.
    """
    if settings.current_tolerance_A is not None:
        return settings.current_tolerance_A
    range_A = max(abs(value) for value in capabilities.current_A)
    own_A = _SHARE_OF_LIMITS * max(abs(value) for value in limits.current_A)
    return min(_DEFAULT_TOLERANCE * range_A, max(own_A, _BEST_ACCURACY * range_A))


def _notes(settings: BenchSettings, request: RunRequest, skipped_points: int) -> Iterator[Note]:
    if request.initial_soc is None:
        yield (
            "warning",
            "soc_unknown",
            f"{settings.name}: no initial state of charge, so its limits are not checked in this run",
        )
    if skipped_points:
        yield (
            "warning",
            "steps_skipped",
            f"{settings.name}: {skipped_points} steps of the profile are shorter than the period and not played",
        )
