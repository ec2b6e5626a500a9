"""From a protocol to its program: C-rates by the capacity, directions, loops, jumps, and what limits do not allow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from bench_service.errors import Where
from bench_service.protocol.directions import direction
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.program import (
    VOLTAGE_MARGIN_V,
    Again,
    End,
    Instruction,
    Jump,
    Play,
    Program,
    Round,
    SetChamber,
    Window,
)
from bench_service.protocol.soaking import check_chamber
from bench_service.protocol.steps import STATES, Bound, Protocol, Record, Step

_LAWS: Mapping[str, str] = {
    "rest": "rest",
    "soak": "rest",
    "constant_current": "current",
    "constant_voltage": "voltage",
    "cc_cv": "cc_cv",
    "power": "power",
    "resistance": "resistance",
    "profile": "profile",
}
_SLACK = 1e-9


def compile_protocol(protocol: Protocol, capacity_Ah: float, window: Window) -> Program:
    """Make a protocol ready for a cell and the limits of a run.

    Parameters
    ----------
    protocol : Protocol
    capacity_Ah : float
        Of the cell; the protocol's own comes first.
    window : Window
        Limits of the run.

    Raises
    ------
    ProtocolError
        A step leaves a limit, has no end, or goes where there is nothing.
    """
    compiler = _Compiler(protocol.capacity_Ah or capacity_Ah, window)
    compiler.add(protocol.steps, _Scope(protocol.record))
    instructions = tuple(compiler.resolve())
    if compiler.number == 0:
        raise ProtocolError("no step plays anything", ("steps",))
    charge_Ah = protocol.limits.get("charge_Ah")
    bounded = replace(window, charge_Ah=charge_Ah)
    return Program(protocol.name, instructions, compiler.counters, compiler.number, compiler.capacity_Ah, bounded)


class _Scope:
    """What a step has of the groups around it."""

    def __init__(self, record: Record, limits: Mapping[str, tuple[float, float]] | None = None) -> None:
        self.record = record
        self.limits = dict(limits or {})
        self.ends: tuple[End, ...] = ()

    def inside(self, step: Step) -> _Scope:
        scope = _Scope(step.record or self.record, self.limits | dict(step.limits))
        scope.ends = self.ends
        return scope


class _Compiler:
    def __init__(self, capacity_Ah: float, window: Window) -> None:
        self.capacity_Ah = capacity_Ah
        self.window = window
        self.counters = 0
        self.number = 0
        self._code: list[Instruction] = []
        self._labels: dict[str, int] = {}
        self._gotos: list[tuple[int, Step]] = []

    def add(self, steps: tuple[Step, ...], scope: _Scope) -> None:
        for step in steps:
            if step.label is not None:
                if step.label in self._labels and step.kind != "loop":
                    raise ProtocolError("the label is taken", (*step.where, "label"), value=step.label)
                self._labels.setdefault(step.label, len(self._code))
            self._add(step, scope)

    def resolve(self) -> list[Instruction]:
        for at, step in self._gotos:
            jump = self._code[at]
            assert isinstance(jump, Jump)
            if step.to not in self._labels:
                raise ProtocolError("there is no such label", (*step.where, "to"), value=step.to)
            self._code[at] = replace(jump, target=self._labels[step.to])
        return self._code

    def _add(self, step: Step, scope: _Scope) -> None:
        if step.temperature_degC is not None:
            check_chamber(self.window, step.kind, step.temperature_degC, step.where)
        if step.kind == "chamber":
            self._code.append(SetChamber(step.temperature_degC or 0.0))
        elif step.kind == "group":
            self._group(step, scope.inside(step))
        elif step.kind == "loop":
            self._loop(step, scope.inside(step))
        elif step.kind == "goto":
            condition = None if step.condition is None else self._state(step.condition, (*step.where, "if"), None)
            self._gotos.append((len(self._code), step))
            self._code.append(Jump(self._counter(), 0, step.count, condition))
        elif step.kind == "pulse":
            self._pulse(step, scope.inside(step))
        elif step.kind == "profile" and step.count > 1:
            self.number += 1
            self._repeated(step.count, [self._play(step, scope.inside(step), self.number)])
        elif step.kind == "design":
            raise ProtocolError("the design has not been made yet", step.where, remedy="start it through the service")
        elif step.kind != "mark":
            self.number += 1
            self._code.append(self._play(step, scope.inside(step), self.number))

    def _counter(self) -> int:
        self.counters += 1
        return self.counters - 1

    def _group(self, step: Step, scope: _Scope) -> None:
        first = len(self._code)
        # The end of the group is not known yet: -1 stands for it.
        scope.ends += tuple(self._state(each, (*step.where, "until"), -1) for each in step.until)
        self.add(step.steps, scope)
        self._point(first, -1, len(self._code))

    def _loop(self, step: Step, scope: _Scope) -> None:
        played, counter, first = self.number, self._counter(), len(self._code)
        cycle = step.counts_cycles
        if cycle is None:
            cycle = not any(_counts(each) for each in step.steps)
        self._code.append(Round(counter, cycle))
        self.add(step.steps, scope)
        if self.number == played:
            raise ProtocolError("a loop in which nothing is played", step.where)
        until = tuple(self._state(each, (*step.where, "until"), None) for each in step.until)
        self._code.append(Again(counter, first, step.count, cycle, until))

    def _pulse(self, step: Step, scope: _Scope) -> None:
        self.number += 1
        on = replace(step, kind="constant_current", until=(*step.until, Bound("time_s", step.on_s or 0.0, True)))
        plays = [self._play(on, scope, self.number)]
        # Any end but that of its time leaves the whole train of pulses.
        ends = tuple(each if each.quantity == "time_s" else replace(each, target=-2) for each in plays[0].ends)
        plays[0] = replace(plays[0], ends=ends, name=step.name or "pulse")
        if step.off_s:
            off = replace(step, kind="rest", level=None, until=(Bound("time_s", step.off_s, True),))
            plays.append(replace(self._play(off, scope, self.number), name=f"{step.name or 'pulse'}, rest"))
        self._repeated(step.count, plays)

    def _repeated(self, count: int, plays: list[Play]) -> None:
        first, counter = len(self._code), self._counter()
        self._code += [Round(counter, False), *plays, Again(counter, first, count, False)]
        self._point(first, -2, len(self._code))

    def _point(self, first: int, mark: int, target: int) -> None:
        """Let ends that wait for it go to `target`."""
        for k in range(first, len(self._code)):
            each = self._code[k]
            if isinstance(each, Play) and any(end.target == mark for end in each.ends):
                ends = tuple(replace(end, target=target) if end.target == mark else end for end in each.ends)
                self._code[k] = replace(each, ends=ends)

    # --- steps that play -----------------------------------------------------------------------------------

    def _play(self, step: Step, scope: _Scope, number: int) -> Play:
        level = self._level(step)
        play = Play(
            law=_LAWS[step.kind],
            where=step.where,
            number=number,
            name=step.name or step.kind,
            level=level,
            voltage_V=step.voltage_V or 0.0,
            # Those of a group come first: they leave more than the step.
            ends=scope.ends + tuple(self._end(each, step, level) for each in step.until),
            limits=tuple((name, *window) for name, window in scope.limits.items()),
            record=scope.record,
            soak=step.soak,
        )
        if step.points is not None:
            play = self._profile(play, step)
        elif not (play.ends or play.soak):
            raise ProtocolError("the step has no end", (*step.where, "until"), remedy="give it one")
        if play.law == "rest" and play.soak is None and all(end.quantity == "dV_dt_V_per_s" for end in play.ends):
            raise ProtocolError("a rest needs a time, too", (*step.where, "until"))
        self._check_voltage(step, step.voltage_V, "voltage_V")
        for window in (step.clip_voltage_V,) if step.clip_voltage_V else ():
            for value in window:
                if abs(value) != float("inf"):
                    self._check_voltage(step, value, "clip_voltage_V")
        return play

    def _level(self, step: Step) -> float:
        low, high = self.window.current_A
        if step.level is None:
            return max(-low, high)
        unit, value = step.level
        if unit in ("power_W", "resistance_Ohm"):
            return value
        current_A = value * self.capacity_Ah if unit == "rate_C" else value
        if step.kind == "constant_voltage":
            return current_A
        self._check_current(step, current_A, unit)
        return current_A

    def _check_current(self, step: Step, current_A: float, key: str) -> None:
        low, high = self.window.current_A
        if not low - _SLACK <= current_A <= high + _SLACK:
            raise ProtocolError(
                "current outside the limit", (*step.where, key), value=current_A, unit="A", limit=(low, high),
                remedy="lower it",
            )  # fmt: skip

    def _check_voltage(self, step: Step, voltage_V: float | None, key: str) -> None:
        if voltage_V is None:
            return
        low, high = self.window.voltage_V[0] + VOLTAGE_MARGIN_V, self.window.voltage_V[1] - VOLTAGE_MARGIN_V
        if not low - _SLACK <= voltage_V <= high + _SLACK:
            raise ProtocolError(
                f"nearer than {VOLTAGE_MARGIN_V:g} V to the run's limits, or beyond them,", (*step.where, key),
                value=voltage_V, unit="V", limit=(low, high),
                remedy="stay inside, or widen the bench's voltage limits where the cell's data sheet allows it",
            )  # fmt: skip

    def _profile(self, play: Play, step: Step) -> Play:
        assert step.points is not None
        times, unit, values = step.points
        if unit == "rate_C":
            values = tuple(value * self.capacity_Ah for value in values)
        if unit != "power_W":
            for k, value in enumerate(values[:-1]):
                self._check_current(step, value, f"{unit}.{k}")
        clip = step.clip_voltage_V
        return replace(play, times_s=times, values=values, in_watts=unit == "power_W", clip_voltage_V=clip)

    # --- ends ----------------------------------------------------------------------------------------------

    def _end(self, bound: Bound, step: Step, level: float) -> End:
        where = (*step.where, "until", bound.quantity)
        above = bound.above
        if above is None:
            above = direction(bound, step, level, where)
        end = self._si(bound, above, None)
        if end.quantity == "voltage_V" and step.kind in ("constant_voltage", "cc_cv") and bound.above is None:
            raise ProtocolError("a hold does not end by its voltage", where, remedy='say "above" or "below"')
        if end.quantity == "voltage_V":
            self._check_voltage(step, end.value, "until.voltage_V")
        return end

    def _si(self, bound: Bound, above: bool, target: int | None) -> End:
        quantity, value = bound.quantity, bound.value
        if quantity == "rate_C":
            quantity, value = "current_A", value * self.capacity_Ah
        elif quantity == "charge_share":
            quantity, value = "charge_Ah", value * self.capacity_Ah
        if quantity in ("current_A", "charge_Ah"):
            value = abs(value)
        return End(quantity, above, value, target, bound.over_s)

    def _state(self, bound: Bound, where: Where, target: int | None) -> End:
        if bound.quantity not in STATES or bound.above is None:
            raise ProtocolError(
                "no condition between steps", (*where, bound.quantity), remedy='use "above" or "below" of a state'
            )
        return self._si(bound, bound.above, target)


def _counts(step: Step) -> bool:
    """Whether a loop that counts cycles is inside."""
    if step.kind == "loop":
        return step.counts_cycles is not False
    return any(_counts(each) for each in step.steps)
