"""One run, tick by tick: sample -> safety -> recorder queue -> observer -> live feed -> set-point.

However it ends - done, tripped, stopped, cancelled, link or recorder lost - the cycler is then brought to rest with
its output off.
"""

import logging
import math

from bench_service.bench.chamber.in_run import RunChamber
from bench_service.bench.clock import Tick
from bench_service.bench.holding import Holding
from bench_service.bench.input_watch import InputWatch
from bench_service.bench.judging import PlausibilityJudge, SettingsJudge
from bench_service.bench.observing import Observing
from bench_service.bench.quality import sample_flags
from bench_service.bench.recording import RecorderError
from bench_service.bench.rest import bring_to_rest, uncancelled
from bench_service.bench.run import EndState, RunEnd, RunParts, RunPlan
from bench_service.bench.safety import (
    Context,
    Track,
    Trip,
    TripError,
    check,
    check_age,
    check_at_rest,
    check_held,
    follow,
)
from bench_service.bench.soc import count_charge
from bench_service.protocol.guard import ramped
from bench_service.streams import OBSERVER, SAMPLES, STEPS
from drivers.cycler import CyclerError, DeviceLimits, Reading, SetPointRefusedError

_log = logging.getLogger(__name__)
_TIME_TOLERANCE_S = 1e-9
_KEEP_ALIVE_S = 0.5


class RunLoop:
    """Plays one run; used once."""

    def __init__(self, plan: RunPlan, parts: RunParts) -> None:
        self._plan = plan
        self._parts = parts
        self._limits = plan.request.limits
        self._track = Track()
        self._plausibility = PlausibilityJudge(plan, parts.notify)
        self._settings = SettingsJudge(parts.cycler)
        self._soc = plan.request.initial_soc
        self._commanded_A = 0.0
        self._settled_from_s = -math.inf
        self._missed = 0
        self._holding = Holding(plan.rules.bench, parts)
        self._watch = InputWatch(plan.rules.bench, parts.cycler, parts.stop)
        self._chamber = RunChamber(parts.chamber, parts.clock)
        self._gap = False
        self._next_record = 0
        # A sample that is counted and not stored, with what the loop then knew of the current.
        self._unstored: tuple[Tick, Reading, tuple[float, float]] | None = None
        self._observing = Observing(parts.observer, parts.notify)
        self._hold_V: float | None = None  # that the device holds itself

    async def play(self) -> RunEnd:
        """Play the run to its end, whatever that is, and bring the cycler to rest."""
        state: EndState = "fault"
        code, reason = "internal_error", None
        unrested: str | None = None
        try:
            state, code, reason = await self._guarded()
        finally:
            self._parts.clock.close()
            unrested = await uncancelled(bring_to_rest(self._parts.cycler))
            await uncancelled(self._end_chamber(completed=state == "completed"))
        self._store_last()
        self._tell_steps(closing=True)
        if unrested is not None and state != "fault":
            state, code, reason = "fault", "not_at_rest", f"the cycler did not confirm rest: {unrested}"
        return RunEnd(state, code, reason, unrested is None, self._missed)

    async def _end_chamber(self, *, completed: bool) -> None:
        if (told := await self._chamber.end(completed=completed)) is not None:
            self._parts.notify("error", "chamber_not_told", f"{self._plan.rules.bench}: {told}")

    async def _guarded(self) -> tuple[EndState, str, str | None]:
        try:
            # An order that is older than the run: the output is not switched on for it.
            if (order := self._parts.stop.order) is not None:
                return order.state, "stop", order.reason
            await self._begin()
            return await self._ticks()
        except TripError as error:
            return "fault", error.code, str(error)
        except RecorderError as error:
            return "fault", "recorder", f"{self._plan.rules.bench}: {error}"
        except CyclerError as error:
            return "fault", "cycler", f"{self._plan.rules.bench}: cycler: {error}"
        except Exception as error:
            # A defect must end like any other fault: at rest, with the samples stored.
            _log.exception("run %s", self._plan.request.run_id)
            return "fault", "internal_error", f"{self._plan.rules.bench}: internal error: {error!r}"

    async def _begin(self) -> None:
        cycler, limits, clock = self._parts.cycler, self._limits, self._parts.clock
        device = DeviceLimits(limits.voltage_V, limits.current_A, limits.temperature_degC, limits.ramp_A_per_s)
        period_s = self._plan.player.dt_s
        await cycler.acquire(device, self._plan.watchdog_s, period_s if clock.lock_step else None)
        context = Context(self._plan.rules, self._track, 0.0, self._soc, 0.0)
        at_rest = await cycler.sample()
        if trip := check_at_rest(at_rest, context):
            raise TripError(trip)
        self._track = Track(temperature_degC=at_rest.temperature_degC)
        self._watch.heed(at_rest)
        if self._parts.stop.order is None:
            await cycler.output(True)
        clock.start(period_s)

    async def _ticks(self) -> tuple[EndState, str, str | None]:
        clock, stop, recording = self._parts.clock, self._parts.stop, self._parts.recording
        while True:
            await self._watch.until(clock)
            tick = await clock.next_tick()
            if stop.order is not None:
                return stop.order.state, "stop", stop.order.reason
            if tick is None:
                raise RuntimeError("the clock was interrupted without a stop order")
            if self._holding.begins:
                self._store_last()
            if await self._holding.follow(tick):
                self._commanded_A, self._gap = 0.0, not self._holding.active
            if stop.order is None and await self._tick(tick):
                why = self._plan.player.stopped
                return ("completed", "completed", None) if why is None else ("stopped", "protocol", why)
            if recording.full:
                await self._queue_full()

    async def _queue_full(self) -> None:
        if not self._parts.clock.lock_step:
            raise RecorderError(
                f"the recorder has not acknowledged the last {self._parts.recording.n_unacknowledged} samples; "
                "check the disk"
            )
        while not await self._parts.recording.wait_for_room(_KEEP_ALIVE_S):
            # Simulated time stands still, but a simulator takes a silent client for a dead one.
            await self._parts.cycler.sample()

    async def _tick(self, tick: Tick) -> bool:
        """Play one tick; return whether it was the last."""
        self._missed += tick.missed
        self._gap = self._gap or tick.missed > 0
        reading, refused = await self._sample()
        trip = self._judge(tick, reading)
        # What follows a sample is known before it is stored: the last one of a step always is.
        setpoint_A = None if trip or refused else self._next_A(tick, reading)
        on_grid, due = tick.index >= self._next_record, self._plan.player.due
        if due is None or (on_grid and self._observing.active):
            due = on_grid  # an observer steps in the run's sampling time, whatever else is stored between
        self._unstored = tick, reading, (self._commanded_A, self._settled_from_s)
        if due or trip or refused:
            self._record(tick, reading, suspect=trip is not None or refused is not None, on_grid=on_grid)
        self._parts.feed.note_lateness(tick.lateness_s)
        if self._parts.feed.due:
            self._show(tick, reading)
        self._watch.heed(reading)
        # The alarm or limit behind a refused set-point says more than the refusal.
        if trip is not None:
            raise TripError(trip)
        if refused is not None:
            raise refused
        if setpoint_A is None:
            return True
        if self._parts.stop.order is not None:
            return False
        # A stale reading is no ground for a heartbeat: the device's watchdog must see that we are blind.
        if self._track.stale == 0:
            await self._apply(tick, setpoint_A)
            await self._chamber.follow(self._plan.player.chamber_degC)
            if trip := await self._settings.judge(lambda: self._context(tick)):
                raise TripError(trip)
        return False

    def _next_A(self, tick: Tick, reading: Reading) -> float | None:
        """Return the set-point until the next tick; None: there is nothing left to play."""
        player, time_s, pause = self._plan.player, self._track.time_s, self._parts.pause
        if self._holding.active:
            player.wait(time_s)
            return 0.0
        if self._track.stale and player.closed_loop:
            return self._commanded_A  # not applied either; the next fresh sample counts for both
        if pause.skip_wanted:
            pause.skip_wanted = False
            player.skip()
        setpoint_A = player.follow(self._holding.position(tick), reading, time_s, self._soc)
        self._tell_steps()
        # After a pause or missed ticks the profile is further on than the current.
        last_A, most = self._commanded_A, self._limits.ramp_A_per_s
        return None if setpoint_A is None else ramped(most, last_A, setpoint_A, player.dt_s)

    def _tell_steps(self, *, closing: bool = False) -> None:
        """Hand over what ended steps have moved."""
        player = self._plan.player
        if closing:
            player.close()
        for row in player.take_rows(self._track.time_s):
            self._parts.recording.put(STEPS, row)
            self._plausibility.begin_step()

    async def _sample(self) -> tuple[Reading, SetPointRefusedError | None]:
        try:
            reading, refused = await self._parts.cycler.sample(), None
        except SetPointRefusedError as error:
            if error.reading is None:
                raise
            reading, refused = error.reading, error
        return await self._chamber.look(reading), refused

    def _judge(self, tick: Tick, reading: Reading) -> Trip | None:
        clock, plan = self._parts.clock, self._plan
        time_s = clock.sample_time_s(tick, reading.monotonic_s)
        settled = time_s >= self._settled_from_s - _TIME_TOLERANCE_S
        self._track = follow(self._track, plan.rules, reading, time_s, self._commanded_A, settled, self._hold_V)
        if self._soc is not None:
            self._soc = count_charge(self._soc, reading.current_A, self._track.interval_s, plan.request.capacity_Ah)
        context = self._context(tick)
        rule = check_held if self._holding.active else check
        return rule(reading, context) or self._chamber.judge(context) or self._plausibility.judge(reading, context)

    def _context(self, tick: Tick) -> Context:
        now_s = self._parts.clock.elapsed_s(tick)
        held_s = (tick.index - self._holding.position(tick)) * self._plan.player.dt_s
        soc = self._soc if self._plan.counted_soc_limits else None
        return Context(self._plan.rules, self._track, now_s, soc, self._commanded_A, held_s)

    def _store_last(self) -> None:
        """Store the last sample before an end or a pause though it is not due: nothing is counted that none shows."""
        if self._unstored is not None and self._plan.player.closed_loop:
            now = self._commanded_A, self._settled_from_s
            tick, reading, (self._commanded_A, self._settled_from_s) = self._unstored
            self._record(tick, reading, suspect=False, on_grid=False)
            self._commanded_A, self._settled_from_s = now

    def _record(self, tick: Tick, reading: Reading, *, suspect: bool, on_grid: bool) -> None:
        parts, time_s = self._parts, self._track.time_s
        settling = time_s < self._settled_from_s - _TIME_TOLERANCE_S
        self._next_record = (tick.index // self._plan.every + 1) * self._plan.every
        paused = self._holding.active
        told = {"gap": self._gap, "suspect": suspect, "paused": paused, "unverified": self._plan.request.unverified}
        flags = sample_flags(reading, self._track, settling=settling, **told)
        row = (
            time_s,
            reading.current_A,
            reading.voltage_V,
            reading.temperature_degC,
            reading.ambient_degC,
            self._commanded_A,
            reading.sequence,
            flags,
            tick.lateness_s,
            self._plan.player.step_count,
            self._plan.player.cycle_count,
        )
        parts.recording.put(SAMPLES, row)
        self._gap, self._unstored = False, None
        if parts.observer is not None:
            if on_grid:
                self._observing.step(reading)
            parts.recording.put(OBSERVER, (time_s, *self._observing.row))

    def _show(self, tick: Tick, reading: Reading) -> None:
        counted = math.nan if self._soc is None else self._soc
        player = self._plan.player
        self._parts.feed.send(
            reading,
            run_id=self._plan.request.run_id,
            seq=self._parts.recording.n_rows - 1,
            time_s=self._track.time_s,
            setpoint_A=self._commanded_A,
            soc=counted if self._parts.observer is None else self._observing.row.soc,
            soc_std=self._observing.row.soc_std,
            progress=player.progress(self._holding.position(tick)),
            missed_ticks=self._missed,
            **player.view,
        )

    async def _apply(self, tick: Tick, setpoint_A: float) -> None:
        now_s = self._parts.clock.elapsed_s(tick)
        # Whatever held the loop up since the sample (slow observer, stopped process): a heartbeat needs a fresh one.
        if trip := check_age(self._context(tick)):
            raise TripError(trip)
        change_A = abs(setpoint_A - self._commanded_A)
        # A hold moves the current a little at every tick; each of them must be followed at once.
        if change_A > (self._plan.rules.current_tolerance_A if self._plan.player.closed_loop else 0.0):
            ramp = self._limits.ramp_A_per_s
            ramp_s = 0.0 if ramp is None else change_A / ramp
            self._settled_from_s = now_s + self._plan.request.settle_s + ramp_s
        hold_V = None if self._holding.active else self._plan.player.hold_V
        await self._parts.cycler.apply(setpoint_A, hold_V)
        self._commanded_A, self._hold_V = setpoint_A, hold_V
