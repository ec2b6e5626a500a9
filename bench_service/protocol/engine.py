"""The machine that plays a program: a sample in, a set-point out; it knows no device and no clock."""

from __future__ import annotations

from bench_service.durations import in_words
from bench_service.protocol.counters import ENDINGS, Counters, Ending
from bench_service.protocol.guard import broken_limit, careful, leaves, near_end, ramped
from bench_service.protocol.laws import Law, Seen
from bench_service.protocol.program import Again, End, Jump, Play, Program, Round, SetChamber
from bench_service.protocol.quantities import value_of
from bench_service.protocol.response import Response
from bench_service.protocol.slope import Slope
from bench_service.protocol.soaking import Soaking, soaking_of
from bench_service.protocol.state import Standing, StepEnd
from bench_service.protocol.steps import Record

_NEAREST = 0.5  # a time ends with the sample that is nearest to it
_TOLERANCE = 1e-6


class Engine:
    """Plays one program.

    Parameters
    ----------
    program : Program
    dt_s : float
        Period in which samples come.
    standing : Standing or None
        Where to go on; None: at the beginning.
    device_holds : bool
        Whether the device can hold a voltage.

    Attributes
    ----------
    ended : list of StepEnd
        Steps that this sample has ended; emptied by whoever takes them.
    stopped : str or None
        Why the protocol cannot go on; None: it plays, or is at its end.
    """

    def __init__(
        self, program: Program, dt_s: float, standing: Standing | None = None, *, device_holds: bool = False
    ) -> None:
        self.program = program
        self.standing = standing or Standing(counters=[0] * program.n_counters)
        self.ended: list[StepEnd] = []
        self.stopped: str | None = None
        self._dt_s, self._device_holds = dt_s, device_holds
        self._cell = Response(program.capacity_Ah)
        self._play: Play | None = None
        self._law: Law | None = None
        self._slope: Slope | None = None
        self._soaking: Soaking | None = None
        self._last: Seen | None = None
        self._set_A, self._run_s, self._skip = 0.0, 0.0, False
        self.step_count, self.cycle_count = max(self.standing.step_count, 1), self.standing.cycle_count

    @property
    def record(self) -> Record | None:
        """When samples of the step that plays are stored."""
        return None if self._play is None else self._play.record

    @property
    def step_index(self) -> int | None:
        """Number in the document of the step that plays."""
        return None if self._play is None else self._play.number

    @property
    def step_name(self) -> str | None:
        """Name of the step that plays."""
        return None if self._play is None else self._play.name

    @property
    def hold_V(self) -> float | None:
        """Voltage that the device is to hold until the next sample; None: it holds the set-point."""
        return None if self._law is None or self._play is None else self._law.hold_V

    @property
    def chamber_degC(self) -> float | None:
        """Set point of the chamber until the next sample; None: the protocol has not set it."""
        return self.standing.chamber_degC

    def skip(self) -> None:
        """End the step that plays with the next sample."""
        self._skip = True

    def pause(self) -> None:
        """Time passes without current while somebody holds the run."""
        self._set_A = 0.0
        self._cell.look_away()

    def advance(self, seen: Seen) -> float | None:
        """Take a sample and return the set-point until the next one; None: the protocol is at its end, or stopped.

        `step_count` and `cycle_count` are then those that the sample belongs to.
        """
        if self._law is not None and self._law.device_rules:
            self._cell.look_away()  # what the device makes of voltage and current is no answer of the cell
        else:
            self._cell.see(seen.voltage_V, seen.current_A, seen.interval_s)
        self._last = seen
        if self._play is None:
            if not self._start(seen):
                return None
        else:
            self._run_s += seen.interval_s
            self.standing.step.count(seen.voltage_V, seen.current_A, seen.interval_s)
            self.step_count, self.cycle_count = self.standing.step_count, self.standing.cycle_count
            if not self._judge(seen):
                return None
        return self._next(seen)

    def begin(self, seen: Seen) -> bool:
        """Go to the first step, or to the one that is taken up again, without playing it."""
        return self._start(seen)

    def repeat(self, end: StepEnd) -> bool:
        """Go through a step that has been played before, and to the one after it; return whether there is one.

        Raises
        ------
        ValueError
            It is not the step that comes next.
        """
        if (self.standing.at, self.standing.step_count) != (end.at, end.step_count) or self._play is None:
            raise ValueError(f"step {end.step_count} at instruction {end.at} does not follow in this protocol")
        self.standing.step = end.moved
        targets = (each.target for each in self._play.ends if ENDINGS[each.quantity] is end.ended_by)
        going = self._leave(end.ended_by, next(targets, None), end.last)
        self.ended.clear()
        return going

    def close(self) -> None:
        """Note what the step that plays has moved when the run ends."""
        if self._play is not None and self._last is not None:
            self._end(Ending.RUN_ENDED, self._last)
            self._play = None

    # --- one sample ----------------------------------------------------------------------------------------

    def _judge(self, seen: Seen) -> bool:
        """Look whether the step has ended; return whether there is something to play."""
        play = self._play
        assert play is not None
        if (text := broken_limit(play, seen)) is not None:
            return self._stop(text, seen)
        if self._skip:
            self._skip = False
            return self._leave(Ending.SKIPPED, None, seen)
        if play.times_s and self.standing.step.time_s >= play.times_s[-1] - _NEAREST * self._dt_s - _TOLERANCE:
            return self._leave(Ending.PROFILE, None, seen)
        for end in play.ends:
            if self._met(end, seen):
                return self._leave(ENDINGS[end.quantity], end.target, seen)
        ending, reason = (None, None) if self._soaking is None else self._soaking.see(seen)
        if reason is not None:
            return self._stop(reason, seen)
        return True if ending is None else self._leave(ending, None, seen)

    def _next(self, seen: Seen) -> float | None:
        """Return the set-point of the step that plays, or of the first after it that the limits allow."""
        for _ in range(len(self.program.instructions) + 1):
            play, law = self._play, self._law
            assert play is not None and law is not None
            wanted_A = law.current_A(seen, self.standing.step.time_s, self._set_A)
            wanted_A = ramped(self.program.window.ramp_A_per_s, self._set_A, wanted_A, self._dt_s)
            if not self._cell.known and play.law not in ("voltage", "cc_cv"):
                wanted_A = careful(self.program, self._cell, seen, wanted_A)
            flows_A = seen.current_A if law.device_rules else wanted_A
            out = leaves(self.program, play, self._cell, seen, (self._set_A, flows_A), self._dt_s, self.standing)
            if out is None and self._run_s + (1 - _NEAREST) * self._dt_s > self.program.window.duration_s:
                out = "duration_s", f"the run would last longer than {in_words(self.program.window.duration_s)}"
            if out is None:
                if abs(wanted_A - self._set_A) > 0.05 * self.program.capacity_Ah:
                    self._cell.forget_drift()
                self._set_A = wanted_A
                return wanted_A
            quantity, text = out
            end = near_end(play, quantity, flows_A, self.standing, self._dt_s)
            if end is None:
                self._stop(text, seen)
                return None
            if not self._leave(ENDINGS[quantity], end.target, seen):
                return None
        self._stop("no step can be played within the limits", seen)
        return None

    def _met(self, end: End, seen: Seen) -> bool:
        quantity, step = end.quantity, self.standing.step
        if quantity == "time_s":
            return step.time_s >= end.value - _NEAREST * self._dt_s - _TOLERANCE
        if quantity == "current_A" and self._law is not None and not self._law.current_counts:
            return False
        if quantity == "dV_dt_V_per_s":
            assert self._slope is not None
            slope = self._slope.see(step.time_s, seen.voltage_V)
            return slope is not None and (abs(slope) >= end.value if end.above else abs(slope) <= end.value)
        value = value_of(quantity, seen, self.standing)
        if value is None:
            return False
        return value >= end.value if end.above else value <= end.value

    # --- from step to step ---------------------------------------------------------------------------------

    def _start(self, seen: Seen) -> bool:
        """Begin, or go on in the middle of a step."""
        if self.standing.step_count and isinstance(self.program.instructions[self.standing.at], Play):
            resumed = self.standing.step
            self._enter()
            self.standing.step = resumed
            self.standing.step_count -= 1
            self.step_count = self.standing.step_count
            return True
        if not self._move(self.standing.at, seen):
            return False
        self.step_count, self.cycle_count = self.standing.step_count, self.standing.cycle_count
        return True

    def _enter(self) -> None:
        play = self.program.instructions[self.standing.at]
        assert isinstance(play, Play)
        self._play = play
        self._law = Law(play, self.program.window, self._cell, self._dt_s, device_holds=self._device_holds)
        over_s = next((end.over_s for end in play.ends if end.quantity == "dV_dt_V_per_s"), None)
        self._slope = None if over_s is None else Slope(over_s)
        self._soaking = soaking_of(play, self.program.window)
        if play.soak is not None:
            self.standing.chamber_degC = play.soak.temperature_degC
        self.standing.step = Counters()
        self.standing.step_count += 1
        self.standing.fresh = False

    def _leave(self, ending: Ending, target: int | None, seen: Seen) -> bool:
        at = self.standing.at
        self._end(ending, seen)
        self.standing.total = self.standing.total.plus(self.standing.step)
        return self._move(at + 1 if target is None else target, seen)

    def _end(self, ending: Ending, seen: Seen) -> None:
        assert self._play is not None
        state = self.standing
        self.ended.append(
            StepEnd(state.step_count, self._play.number, state.cycle_count, state.at, ending, state.step, seen)
        )

    def _move(self, at: int, seen: Seen) -> bool:
        """Go from instruction to instruction until one plays; return whether one does."""
        state = self.standing
        while at < len(self.program.instructions):
            each = self.program.instructions[at]
            if isinstance(each, Play):
                state.at = at
                self._enter()
                return True
            at = self._through(each, at, seen)
        state.at, self._play = at, None
        return False

    def _through(self, each: Round | Again | Jump | SetChamber, at: int, seen: Seen) -> int:
        """Go through an instruction that plays nothing; return the next one."""
        state = self.standing
        if isinstance(each, SetChamber):
            state.chamber_degC = each.temperature_degC
            return at + 1
        if isinstance(each, Round):
            state.counters[each.counter] = 0
            self._new_cycle(each.cycle)
            return at + 1
        if isinstance(each, Again):
            state.counters[each.counter] += 1
            over = state.counters[each.counter] >= each.count or any(self._met(end, seen) for end in each.until)
            self._new_cycle(each.cycle)
            # The beginning of the loop is passed over: it sets the counter to zero.
            return at + 1 if over else each.back + 1
        met = each.condition is None or self._met(each.condition, seen)
        if met and state.counters[each.counter] < each.most:
            state.counters[each.counter] += 1
            return each.target
        return at + 1

    def _new_cycle(self, counts: bool) -> None:
        if counts and not self.standing.fresh:
            self.standing.cycle_count += 1
            self.standing.fresh = True

    def _stop(self, text: str, seen: Seen) -> bool:
        """End the protocol where it is."""
        assert self._play is not None
        self.stopped = f"{self.program.describe(self._play.number)}: {text}"
        self._end(Ending.LIMIT, seen)
        self._play = None
        return False
