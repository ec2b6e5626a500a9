"""aurora-unicycler JSON (0.4.6): mA and mAh, flat lists with loops that go back to a step number or a tag.

After the package's own documentation (Empa, MIT licence). Numbers may be text, as older versions write them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench_service.errors import Where
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.steps import SCHEMA

_KNOWN = ("unicycler", "sample", "record", "safety", "method")
_PLAYED = {
    "open_circuit_voltage": "rest",
    "constant_current": "constant_current",
    "constant_voltage": "constant_voltage",
}
_UNTIL = {"until_time_s": "time_s", "until_voltage_V": "voltage_V", "until_rate_C": "rate_C"}


def from_unicycler(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return our document of a unicycler protocol.

    Raises
    ------
    ProtocolError
        Something in it is not known, contradicts itself, or cannot be played here; the message names the step.
    """
    _refuse_unknown(data, _KNOWN, ())
    sample, record, safety = (dict(data.get(name) or {}) for name in ("sample", "record", "safety"))
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "name": str(sample.get("name") or "unicycler protocol"),
        "record": _record(record),
        "limits": _limits(safety),
        "steps": _nested(data.get("method")),
        "meta": {"unicycler": {"delay_s": _number(safety.get("delay_s"), ("safety", "delay_s"))}},
    }
    capacity_mAh = _number(sample.get("capacity_mAh"), ("sample", "capacity_mAh"))
    if capacity_mAh is not None:
        document["capacity_Ah"] = _milli(capacity_mAh)
    if "name" in sample:
        document["meta"]["unicycler"]["name"] = sample["name"]
    return {name: value for name, value in document.items() if value not in ({}, None)}


def _record(record: dict[str, Any]) -> dict[str, float]:
    _refuse_unknown(record, ("time_s", "voltage_V", "current_mA"), ("record",))
    found = {name: _number(record.get(name), ("record", name)) for name in ("time_s", "voltage_V", "current_mA")}
    if found["time_s"] is None:
        raise ProtocolError("a unicycler protocol needs record.time_s", ("record", "time_s"))
    current_mA = found.pop("current_mA")
    rule = {name: value for name, value in found.items() if value is not None}
    return rule if current_mA is None else rule | {"current_A": _milli(current_mA)}


def _limits(safety: dict[str, Any]) -> dict[str, Any]:
    names = ("min_voltage_V", "max_voltage_V", "min_current_mA", "max_current_mA", "max_capacity_mAh")
    _refuse_unknown(safety, (*names, "delay_s"), ("safety",))
    low_V, high_V, low_mA, high_mA, charge_mAh = (_number(safety.get(name), ("safety", name)) for name in names)
    limits: dict[str, Any] = {}
    if low_V is not None or high_V is not None:
        limits["voltage_V"] = [low_V, high_V]
    if low_mA is not None or high_mA is not None:
        limits["current_A"] = [None if each is None else _milli(each) for each in (low_mA, high_mA)]
    if charge_mAh is not None:
        limits["charge_Ah"] = _milli(charge_mAh)
    return limits


def _nested(method: Any) -> list[dict[str, Any]]:
    """Return steps in which each loop holds what it repeats."""
    if not isinstance(method, Sequence) or isinstance(method, str) or not method:
        raise ProtocolError("a unicycler protocol needs steps", ("method",))
    tags = {each.get("tag"): k for k, each in enumerate(method) if _kind(each, k) == "tag"}
    # Each entry: index of the first step that it stands for, and the step itself.
    done: list[tuple[int, dict[str, Any]]] = []
    for k, each in enumerate(method):
        kind, where = _kind(each, k), ("method", k)
        if kind == "tag":
            _refuse_unknown(each, ("step", "id", "tag"), where)
            done.append((k, _with_id({"step": "mark", "label": str(each.get("tag", ""))}, each)))
        elif kind == "loop":
            done = _looped(done, each, k, tags)
        elif kind in _PLAYED:
            done.append((k, _played(each, kind, where)))
        else:
            raise ProtocolError(f"step {k + 1} ({kind}) cannot be played here", where, remedy="leave it out")
    return [step for _, step in done]


def _looped(
    done: list[tuple[int, dict[str, Any]]], loop: Mapping[str, Any], k: int, tags: Mapping[Any, int]
) -> list[tuple[int, dict[str, Any]]]:
    where = ("method", k)
    _refuse_unknown(loop, ("step", "id", "loop_to", "cycle_count"), where)
    to, count = loop.get("loop_to", 1), _number(loop.get("cycle_count"), (*where, "cycle_count"))
    if isinstance(to, str) and to in tags:
        first, by_tag = tags[to] + 1, True
    else:
        number = _number(to, (*where, "loop_to"))
        first, by_tag = -1 if number is None else int(number) - 1, False
    if count is None or count < 1 or not 0 <= first < k:
        raise ProtocolError(f"step {k + 1} (loop) needs a cycle_count and a step before it", where, value=to)
    inside = [step for at, step in done if at >= first]
    before = [(at, step) for at, step in done if at < first]
    starts = [at for at, _ in done]
    if first not in starts:
        raise ProtocolError(f"step {k + 1} (loop) goes into the middle of another loop", where, value=to)
    step: dict[str, Any] = {"step": "loop", "count": int(count), "steps": inside}
    if by_tag:
        step["to_mark"] = to
    return [*before, (first, _with_id(step, loop))]


def _played(data: Mapping[str, Any], kind: str, where: Where) -> dict[str, Any]:
    levels = {"constant_current": ("rate_C", "current_mA"), "constant_voltage": ("voltage_V", "until_current_mA")}
    _refuse_unknown(data, ("step", "id", *_UNTIL, *levels.get(kind, ())), where)
    step: dict[str, Any] = {"step": _PLAYED[kind]}
    if kind == "constant_voltage":
        step["voltage_V"] = _number(data.get("voltage_V"), (*where, "voltage_V"))
    if kind == "constant_current":
        rate, current_mA = _rate(data.get("rate_C"), where), _number(data.get("current_mA"), (*where, "current_mA"))
        # The C-rate comes first, as it does there.
        step |= {"rate_C": rate} if rate else {"current_A": _milli(current_mA or 0.0)}
    until: dict[str, Any] = {}
    for name, own in _UNTIL.items():
        value = _rate(data.get(name), where) if own == "rate_C" else _number(data.get(name), (*where, name))
        if value:
            until[own] = value
    current_mA = _number(data.get("until_current_mA"), (*where, "until_current_mA"))
    if current_mA and "rate_C" not in until:
        until["current_A"] = _milli(current_mA)
    if not until:
        raise ProtocolError(f"step {where[1] + 1 if isinstance(where[1], int) else ''} ({kind}) has no end", where)
    return _with_id(step | {"until": until}, data)


def _with_id(step: dict[str, Any], data: Mapping[str, Any]) -> dict[str, Any]:
    return step if data.get("id") is None else step | {"id": data["id"]}


def _kind(data: Any, k: int) -> str:
    if not isinstance(data, Mapping) or not isinstance(data.get("step"), str):
        raise ProtocolError(f"step {k + 1} is incomplete: it needs 'step'", ("method", k))
    return data["step"]


def _refuse_unknown(data: Mapping[str, Any], known: Sequence[str], where: Where) -> None:
    for name, value in data.items():
        if name not in known and value is not None:
            raise ProtocolError("unknown key", (*where, name), remedy="remove it")


def _number(value: Any, where: Where) -> float | None:
    if value is None or (isinstance(value, str) and not value.strip()):
        return None
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ProtocolError("a number is needed", where, value=value) from None


def _rate(value: Any, where: Where) -> float | None:
    if not isinstance(value, str) or not value.strip():
        return None if isinstance(value, str) else _number(value, where)
    text = value.replace(" ", "")
    over, _, under = text.partition("/")
    sign = -1.0 if "D" in over else 1.0
    try:
        return sign * float(over.strip("CD") or 1.0) / float(under or 1.0)
    except (ValueError, ZeroDivisionError):
        raise ProtocolError("no C-rate", (*where, "rate_C"), value=value) from None


def _milli(value: float) -> float:
    return float(f"{value / 1000.0:.15g}")
