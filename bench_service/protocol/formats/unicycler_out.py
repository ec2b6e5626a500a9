"""A protocol as aurora-unicycler (0.4.6) writes it; what it cannot say fails and names the step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench_service.errors import Where
from bench_service.protocol.errors import ProtocolError

VERSION = "0.4.6"
_NAMES = {
    "rest": "open_circuit_voltage",
    "constant_current": "constant_current",
    "constant_voltage": "constant_voltage",
}


def to_unicycler(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a unicycler protocol of one of our documents, in the form that its version 0.4.6 writes.

    Raises
    ------
    ProtocolError
        Something cannot be said there; the message names the step.
    """
    meta = document.get("meta", {}).get("unicycler", {})
    capacity_Ah = document.get("capacity_Ah")
    method: list[dict[str, Any]] = []
    _flatten(document["steps"], (), method)
    if capacity_Ah is None and any("rate_C" in each or "until_rate_C" in each for each in method):
        raise ProtocolError("C-rates need capacity_Ah there", ("capacity_Ah",), remedy="state it")
    record = document.get("record") or {}
    if record.get("time_s") is None:
        raise ProtocolError("unicycler needs a record time", ("record", "time_s"), remedy="state it")
    return {
        "unicycler": {"version": VERSION},
        "sample": {"name": meta.get("name", document["name"]), "capacity_mAh": _kilo(capacity_Ah)},
        "record": {
            "current_mA": _kilo(record.get("current_A")),
            "voltage_V": record.get("voltage_V"),
            "time_s": record["time_s"],
        },
        "safety": _safety(document.get("limits") or {}, meta),
        "method": method,
    }


def _safety(limits: Mapping[str, Any], meta: Mapping[str, Any]) -> dict[str, Any]:
    for name in limits:
        if name not in ("voltage_V", "current_A", "charge_Ah"):
            raise ProtocolError("unicycler has no such limit", ("limits", name), remedy="leave it to the bench")
    low_V, high_V = limits.get("voltage_V", (None, None))
    low_A, high_A = limits.get("current_A", (None, None))
    return {
        "max_voltage_V": high_V,
        "min_voltage_V": low_V,
        "max_current_mA": _kilo(high_A),
        "min_current_mA": _kilo(low_A),
        "max_capacity_mAh": _kilo(limits.get("charge_Ah")),
        "delay_s": meta.get("delay_s"),
    }


def _flatten(steps: Sequence[Mapping[str, Any]], where: Where, method: list[dict[str, Any]]) -> None:
    for k, step in enumerate(steps):
        place = (*where, "steps", k)
        kind = step["step"]
        if kind == "loop":
            first = len(method) + 1
            _only(step, ("count", "steps", "to_mark", "label"), place)
            _flatten(step["steps"], place, method)
            to = step.get("to_mark", first)
            method.append({"id": step.get("id"), "step": "loop", "loop_to": to, "cycle_count": step["count"]})
        elif kind == "mark":
            method.append({"id": step.get("id"), "step": "tag", "tag": step["label"]})
        elif kind == "group":
            _only(step, ("steps",), place)
            _flatten(step["steps"], place, method)
        elif kind == "cc_cv":
            method += _cc_cv(step, place)
        else:
            method.append(_flat(step, place))


def _cc_cv(step: Mapping[str, Any], place: Where) -> list[dict[str, Any]]:
    """Write a CC-CV as two steps; a time that holds for both together cannot be said."""
    _only(step, ("rate_C", "current_A", "voltage_V", "until"), place)
    until = dict(step.get("until") or {})
    if set(until) - {"rate_C", "current_A"} or not until:
        raise ProtocolError(f"{_named(step, place)}: unicycler knows its end by current only", (*place, "until"))
    level = {name: step[name] for name in ("rate_C", "current_A") if name in step}
    charge = {"step": "constant_current", **level, "until": {"voltage_V": step["voltage_V"]}}
    hold = {"step": "constant_voltage", "voltage_V": step["voltage_V"], "until": until}
    return [_flat(charge, place), _flat(hold, place)]


def _flat(step: Mapping[str, Any], place: Where) -> dict[str, Any]:
    kind = step["step"]
    if kind not in _NAMES:
        raise ProtocolError(f"{_named(step, place)} has no counterpart in unicycler", place)
    _only(step, ("rate_C", "current_A", "voltage_V", "until") if kind != "rest" else ("until",), place)
    until = step.get("until") or {}
    for name, value in until.items():
        allowed = {"rest": ("time_s",), "constant_current": ("time_s", "voltage_V")}
        if name not in allowed.get(kind, ("time_s", "rate_C", "current_A")) or isinstance(value, Mapping):
            raise ProtocolError(f"{_named(step, place)}: unicycler has no such end", (*place, "until", name))
    flat: dict[str, Any] = {"id": step.get("id"), "step": _NAMES[kind]}
    if kind == "constant_current":
        flat |= {"rate_C": step.get("rate_C"), "current_mA": _kilo(step.get("current_A"))}
        flat |= {"until_time_s": until.get("time_s"), "until_voltage_V": until.get("voltage_V")}
    elif kind == "constant_voltage":
        if "rate_C" in step or "current_A" in step:
            raise ProtocolError(f"{_named(step, place)}: unicycler has no greatest current of a hold", place)
        flat |= {"voltage_V": step["voltage_V"], "until_time_s": until.get("time_s")}
        flat |= {"until_rate_C": until.get("rate_C"), "until_current_mA": _kilo(until.get("current_A"))}
    else:
        flat["until_time_s"] = until.get("time_s")
    return flat


def _only(step: Mapping[str, Any], known: Sequence[str], place: Where) -> None:
    for name, value in step.items():
        if name not in ("step", "id", "name", "label", *known) and value is not None:
            raise ProtocolError(f"{_named(step, place)}: unicycler cannot say this", (*place, name))


def _named(step: Mapping[str, Any], place: Where) -> str:
    numbers = ".".join(str(each + 1) for each in place if isinstance(each, int))
    return f"step {numbers} ({step['step']})"


def _kilo(value: float | None) -> float | None:
    return None if value is None else float(f"{value * 1000.0:.12g}")
