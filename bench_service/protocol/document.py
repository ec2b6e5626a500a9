"""Reads a protocol of our own schema; what is wrong with it is said with the path to it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from bench_service.errors import Where
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.fields import Fields, number
from bench_service.protocol.steps import ENDS, SCHEMA, SLOPE_OVER_S, STATES, Bound, Protocol, Record, Soak, Step

_MOST_STEPS = 2000
_DEEPEST = 8
_LIMITS = ("voltage_V", "current_A", "temperature_degC", "soc")
# kind of step -> the level that it needs, one of these
_NEEDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "rest": (),
        "constant_current": ("current_A", "rate_C"),
        "constant_voltage": (),
        "cc_cv": ("current_A", "rate_C"),
        "power": ("power_W",),
        "resistance": ("resistance_Ohm",),
        "profile": (),
        "pulse": ("current_A", "rate_C"),
        "design": (),
        "loop": (),
        "group": (),
        "goto": (),
        "mark": (),
        "chamber": (),
        "soak": (),
    }
)
_ENDLESS = ("mark", "chamber", "soak")  # they have no end that is written
_SOAK_WITHIN_K, _SOAK_HOLD_S, _SOAK_LIMIT_S = 1.0, 600.0, 14400.0
KINDS = tuple(_NEEDS)


def read_protocol(document: Any) -> Protocol:
    """Read a protocol of our own schema.

    Raises
    ------
    ProtocolError
        The first thing that is wrong with it, with the path to it.
    """
    fields = Fields(document)
    schema = fields.take("schema")
    if schema != SCHEMA:
        raise ProtocolError("no protocol of this program", ("schema",), value=schema, remedy=f"write {SCHEMA!r}")
    name = fields.text("name")
    if name is None or len(name) > 200:
        raise ProtocolError("a protocol needs a name of at most 200 characters", ("name",))
    fields.text("description")
    fields.take("meta")
    capacity_Ah = fields.positive("capacity_Ah")
    record = read_record(fields.take("record"), ("record",))
    limits = _run_limits(fields.take("limits"))
    steps = _steps(fields.take("steps"), ("steps",), 0)
    fields.done()
    if sum(_size(step) for step in steps) > _MOST_STEPS:
        raise ProtocolError("too many steps", ("steps",), limit=_MOST_STEPS, remedy="use loops")
    return Protocol(name, capacity_Ah, record or Record(), limits, steps, document)


def read_record(data: Any, where: Where) -> Record | None:
    """Read when samples are stored; raises `ProtocolError`."""
    if data is None:
        return None
    fields = Fields(data, where)
    record = Record(fields.positive("time_s"), fields.positive("voltage_V"), fields.positive("current_A"))
    fields.done()
    return record


def _size(step: Step) -> int:
    return 1 + sum(_size(each) for each in step.steps)


def _run_limits(data: Any) -> dict[str, Any]:
    if data is None:
        return {}
    fields = Fields(data, ("limits",))
    limits: dict[str, Any] = {name: list(window) for name in _LIMITS if (window := fields.window(name)) is not None}
    for name in ("ramp_A_per_s", "duration_s", "charge_Ah"):
        if (value := fields.positive(name)) is not None:
            limits[name] = value
    fields.done()
    return limits


def _steps(data: Any, where: Where, depth: int) -> tuple[Step, ...]:
    if not isinstance(data, list | tuple) or not data:
        raise ProtocolError("an array of at least one step is needed", where)
    if depth > _DEEPEST:
        raise ProtocolError("nested too deeply", where, limit=_DEEPEST)
    return tuple(_step(each, (*where, k), depth) for k, each in enumerate(data))


def _step(data: Any, where: Where, depth: int) -> Step:
    fields = Fields(data, where)
    kind = fields.take("step")
    if not isinstance(kind, str) or kind not in _NEEDS:
        raise ProtocolError("unknown step", fields.at("step"), value=kind, remedy=f"choose from {', '.join(KINDS)}")
    step = Step(
        kind=kind,
        where=where,
        name=fields.text("name"),
        label=fields.text("label"),
        level=_level(fields, kind),
        until=() if kind in _ENDLESS else _until(fields.take("until"), fields.at("until")),
        limits=_step_limits(fields.take("limits"), fields.at("limits")),
        record=read_record(fields.take("record"), fields.at("record")),
        **_own(fields, kind, depth),
    )
    fields.take("id")
    fields.done()
    return step


def _level(fields: Fields, kind: str) -> tuple[str, float] | None:
    allowed = ("current_A", "rate_C") if kind == "constant_voltage" else _NEEDS[kind]
    given = [name for name in allowed if name in fields]
    if len(given) > 1:
        raise ProtocolError(f"{given[0]} and {given[1]} say the same thing", fields.at(given[1]), remedy="remove one")
    if not given:
        if _NEEDS[kind]:
            raise ProtocolError(f"{kind} needs {' or '.join(_NEEDS[kind])}", fields.where)
        return None
    name = given[0]
    value = fields.rate(name) if name == "rate_C" else fields.number(name)
    assert value is not None
    if name == "resistance_Ohm" or kind == "constant_voltage":
        value = abs(value)
    if value == 0:
        raise ProtocolError("must not be 0", fields.at(name), remedy="use a rest")
    return name, value


def _own(fields: Fields, kind: str, depth: int) -> dict[str, Any]:
    """Read what only this kind of step has."""
    if kind in ("constant_voltage", "cc_cv"):
        voltage_V = fields.number("voltage_V")
        if voltage_V is None:
            raise ProtocolError(f"{kind} needs voltage_V", fields.where)
        return {"voltage_V": voltage_V}
    if kind == "profile":
        return {"points": _points(fields), "clip_voltage_V": fields.window("clip_voltage_V"), "count": _count(fields)}
    if kind == "pulse":
        on_s, off_s = fields.positive("on_s"), fields.number("off_s", 0.0)
        if on_s is None:
            raise ProtocolError("pulse needs on_s", fields.where)
        return {"on_s": on_s, "off_s": off_s or 0.0, "count": _count(fields)}
    if kind in ("loop", "group"):
        steps = _steps(fields.take("steps"), fields.at("steps"), depth + 1)
        if kind == "group":
            return {"steps": steps}
        count = fields.count("count")
        if count is None:
            raise ProtocolError("loop needs count", fields.where)
        fields.text("to_mark")  # how another program calls the place it goes back to
        return {"steps": steps, "count": count, "counts_cycles": fields.flag("counts_cycles")}
    if kind == "goto":
        return _goto(fields)
    if kind in ("chamber", "soak"):
        return _chambered(fields, kind)
    if kind == "design":
        request = fields.take("request")
        if not isinstance(request, Mapping):
            raise ProtocolError("design needs a request", fields.where)
        return {"design": request}
    return {}


def _chambered(fields: Fields, kind: str) -> dict[str, Any]:
    temperature_degC = fields.number("temperature_degC", -273.0, 1000.0)
    if temperature_degC is None:
        raise ProtocolError(f"{kind} needs temperature_degC", fields.where)
    if kind == "chamber":
        return {"temperature_degC": temperature_degC}
    hold_s, at_limit = fields.number("hold_s", 0.0), fields.take("at_limit")
    if at_limit not in (None, "stop", "go_on"):
        remedy = 'write "stop" or "go_on"'
        raise ProtocolError("unknown way to go on", fields.at("at_limit"), value=at_limit, remedy=remedy)
    soak = Soak(
        temperature_degC=temperature_degC,
        within_K=fields.positive("within_K") or _SOAK_WITHIN_K,
        hold_s=_SOAK_HOLD_S if hold_s is None else hold_s,
        limit_s=fields.positive("limit_s") or _SOAK_LIMIT_S,
        goes_on=at_limit == "go_on",
    )
    if soak.limit_s < soak.hold_s:
        raise ProtocolError(
            "shorter than the time to hold", fields.at("limit_s"), value=soak.limit_s, unit="s", limit=soak.hold_s
        )
    return {"temperature_degC": temperature_degC, "soak": soak}


def _count(fields: Fields) -> int:
    return fields.count("count") or 1


def _goto(fields: Fields) -> dict[str, Any]:
    to, most = fields.text("to"), fields.count("most")
    if to is None or most is None:
        raise ProtocolError("goto needs to, a label, and most, how often at most", fields.where)
    bounds = _until(fields.take("if"), fields.at("if"))
    if len(bounds) > 1:
        raise ProtocolError("goto takes one condition", fields.at("if"))
    for bound in bounds:
        if bound.quantity not in STATES or bound.above is None:
            remedy = f'give "above" or "below" to one of {", ".join(STATES)}'
            raise ProtocolError("no condition for a goto", fields.at("if", bound.quantity), remedy=remedy)
    return {"to": to, "count": most, "condition": bounds[0] if bounds else None}


def _points(fields: Fields) -> tuple[tuple[float, ...], str, tuple[float, ...]]:
    times = fields.numbers("time_s")
    given = [name for name in ("current_A", "rate_C", "power_W") if name in fields]
    if times is None or len(given) != 1:
        raise ProtocolError("profile needs time_s and one of current_A, rate_C, power_W", fields.where)
    values = fields.numbers(given[0])
    assert values is not None
    if len(times) != len(values) or len(times) < 2:
        raise ProtocolError("two rows or more of equal number are needed", fields.at(given[0]), value=len(values))
    if times[0] != 0 or any(b <= a for a, b in zip(times, times[1:], strict=False)):
        raise ProtocolError("times must start at 0 and rise", fields.at("time_s"))
    return times, given[0], values


def _until(data: Any, where: Where) -> tuple[Bound, ...]:
    if data is None:
        return ()
    if isinstance(data, list | tuple):
        return tuple(bound for k, each in enumerate(data) for bound in _until(each, (*where, k)))
    fields = Fields(data, where)
    found = tuple(_bound(fields, name) for name in (*ENDS, "cycle") if name in fields)
    fields.done()
    return found


def _bound(fields: Fields, name: str) -> Bound:
    where = fields.at(name)
    value = fields.take(name)
    if isinstance(value, Mapping):
        inner = Fields(value, where)
        above, below = inner.number("above"), inner.number("below")
        over_s = inner.positive("over_s") or SLOPE_OVER_S
        inner.done()
        if (above is None) == (below is None):
            raise ProtocolError('one of "above" and "below" is needed', where)
        return Bound(name, above if above is not None else below or 0.0, above is not None, over_s)
    if name == "rate_C" and isinstance(value, str):
        value = Fields({"rate_C": value}, fields.where).rate("rate_C")
    return Bound(name, number(value, where), None)


def _step_limits(data: Any, where: Where) -> dict[str, tuple[float, float]]:
    if data is None:
        return {}
    fields = Fields(data, where)
    limits = {name: window for name in _LIMITS if (window := fields.window(name)) is not None}
    fields.done()
    return limits
