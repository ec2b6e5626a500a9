"""PyBaMM experiment strings, such as ``Charge at C/3 for 3 hours or until 4.2 V``.

After PyBaMM's documentation of ``pybamm.Experiment`` (BSD-3). There discharge is positive; in these strings the word
says the direction, so that no sign is met.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench_service.errors import Where
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.fields import Fields
from bench_service.protocol.steps import SCHEMA

_MOST_STRINGS = 10_000
_NUMBER = r"(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|\.\d+)"
_TIME = re.compile(rf"^{_NUMBER}\s*(s|sec|second|seconds|m|min|minute|minutes|h|hour|hours)$")
_VALUE = re.compile(rf"^{_NUMBER}\s*(mA|A|mV|V|mW|W|C)$")
_SHARE = re.compile(rf"^C/{_NUMBER}$")
_STEP = re.compile(r"^(Charge|Discharge|Hold|Rest)\b\s*(?:at\s+(.+?))?(?:\s+(for|until)\s+(.+))?$", re.IGNORECASE)
_TEMPERATURE = re.compile(r"temperature|\bat\s+-?[\d.]+\s*(?:oC|°C|degC)\b", re.IGNORECASE)
_SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0}
_LEVELS = {"A": "current_A", "W": "power_W", "C": "rate_C", "V": "voltage_V"}
_STEPS = {"current_A": "constant_current", "rate_C": "constant_current", "power_W": "power"}


def from_pybamm(experiment: Sequence[Any], name: str = "PyBaMM experiment") -> dict[str, Any]:
    """Return our document of an experiment: strings, or lists of strings, each of which is one cycle.

    Raises
    ------
    ProtocolError
        A string is not understood; the message names it.
    """
    steps: list[dict[str, Any]] = []
    for k, each in enumerate(experiment):
        if isinstance(each, str):
            steps.append(_read(each, (k,)))
        elif isinstance(each, Sequence):
            inside = [_read(text, (k, n)) for n, text in enumerate(each)]
            steps.append({"step": "loop", "count": 1, "steps": inside})
        else:
            raise ProtocolError("a string is needed", ("experiment", k))
    return {"schema": SCHEMA, "name": name, "steps": steps}


def read_strings(path: Path) -> dict[str, Any]:
    """Return our document of a text file with one string a line; raises `ProtocolError`."""
    lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines()]
    return from_pybamm([line for line in lines if line and not line.startswith("#")], path.stem)


def _read(text: Any, place: Where) -> dict[str, Any]:
    where = ("experiment", *place)
    if isinstance(text, str) and _TEMPERATURE.search(text):
        remedy = 'put {"step": "soak"} or {"step": "chamber"} with temperature_degC before it, in a protocol of our own'
        raise ProtocolError(f"a string has no temperature: {text!r}", where, remedy=remedy)
    found = _STEP.match(text.strip()) if isinstance(text, str) else None
    if found is None:
        raise ProtocolError(f"not understood: {text!r}", where, remedy='e.g. "Discharge at 1C until 2.5 V"')
    verb, level, first, rest = found[1].lower(), found[2], found[3], found[4]
    step = _level(verb, level, text, where)
    until: dict[str, Any] = {}
    if first is not None:
        parts = re.split(r"\s+or\s+(?=for\b|until\b)", f"{first} {rest}", flags=re.IGNORECASE)
        for part in parts:
            _end(until, part, verb, text, where)
    if not until:
        raise ProtocolError(f"{text!r} has no end", where, remedy="PyBaMM's default length is not taken over")
    return step | {"until": until}


def _level(verb: str, level: str | None, text: str, where: Where) -> dict[str, Any]:
    if verb == "rest":
        if level is not None:
            raise ProtocolError(f"not understood: {text!r}", where)
        return {"step": "rest"}
    quantity, value = _value(level or "", text, where)
    if verb == "hold":
        if quantity != "voltage_V":
            raise ProtocolError(f"only a voltage is held here: {text!r}", where)
        return {"step": "constant_voltage", "voltage_V": value}
    if quantity not in _STEPS:
        raise ProtocolError(f"not understood: {text!r}", where)
    return {"step": _STEPS[quantity], quantity: value if verb == "charge" else -value}


def _end(until: dict[str, Any], part: str, verb: str, text: str, where: Where) -> None:
    word, _, said = part.strip().partition(" ")
    if word.lower() == "for":
        found = _TIME.match(said.strip())
        if found is None:
            raise ProtocolError(f"no time in {text!r}", where, value=said)
        until["time_s"] = float(found[1]) * _SECONDS[found[2][0]]
        return
    quantity, value = _value(said, text, where)
    allowed = {"hold": ("current_A", "rate_C"), "rest": ()}.get(verb, ("voltage_V",))
    if quantity not in allowed:
        raise ProtocolError(f"{verb} does not end by {said!r} here", where)
    until[quantity] = value


def _value(said: str, text: str, where: Where) -> tuple[str, float]:
    said = said.strip()
    if (share := _SHARE.match(said)) is not None:
        return "rate_C", 1.0 / float(share[1])
    found = _VALUE.match(said)
    if found is None:
        raise ProtocolError(f"no value with a unit in {text!r}", where, value=said)
    scale = 1e-3 if found[2].startswith("m") else 1.0
    return _LEVELS[found[2].removeprefix("m")], float(found[1]) * scale


# --- out ---------------------------------------------------------------------------------------------------


def to_pybamm(document: Mapping[str, Any]) -> list[str]:
    """Return the strings of an experiment; loops are written out.

    Raises
    ------
    ProtocolError
        Something cannot be said there; the message names the step.
    """
    strings: list[str] = []
    for name in document.get("limits") or {}:
        raise ProtocolError("PyBaMM's strings know no limits of an experiment", ("limits", name), remedy="leave it out")
    _write(document["steps"], (), strings)
    return strings


def _write(steps: Sequence[Mapping[str, Any]], where: Where, strings: list[str]) -> None:
    for k, step in enumerate(steps):
        place = (*where, "steps", k)
        kind = step["step"]
        if len(strings) > _MOST_STRINGS:
            raise ProtocolError("too many strings", place, limit=_MOST_STRINGS, remedy="fewer rounds")
        if kind in ("loop", "group"):
            if step.get("until"):
                raise ProtocolError(f"{_named(step, place)}: PyBaMM knows no end of a {kind}", (*place, "until"))
            for _ in range(step.get("count", 1)):
                _write(step["steps"], place, strings)
        elif kind == "cc_cv":
            strings += _cc_cv(step, place)
        elif kind != "mark":
            strings.append(_string(step, place))


def _cc_cv(step: Mapping[str, Any], place: Where) -> list[str]:
    until = step.get("until") or {}
    if set(until) - {"rate_C", "current_A"} or not until:
        raise ProtocolError(f"{_named(step, place)}: two strings know its end by current only", (*place, "until"))
    level = {name: step[name] for name in ("rate_C", "current_A") if name in step}
    charge = {"step": "constant_current", **level, "until": {"voltage_V": step["voltage_V"]}}
    hold = {"step": "constant_voltage", "voltage_V": step["voltage_V"], "until": until}
    return [_string(charge, place), _string(hold, place)]


def _string(step: Mapping[str, Any], place: Where) -> str:
    kind = step["step"]
    for name in ("limits", "record"):
        if step.get(name):
            raise ProtocolError(f"{_named(step, place)}: a string cannot say {name}", (*place, name))
    if kind == "rest":
        head, ends = "Rest", ("time_s",)
    elif kind == "constant_voltage" and not {"rate_C", "current_A"} & set(step):
        head, ends = f"Hold at {_shown(step['voltage_V'])} V", ("time_s", "rate_C", "current_A")
    elif kind in ("constant_current", "power"):
        name = next(each for each in ("rate_C", "current_A", "power_W") if step.get(each) is not None)
        value = _plain(step, name, place)
        verb = "Charge" if value > 0 else "Discharge"
        head, ends = f"{verb} at {_with_unit(name, abs(value))}", ("time_s", "voltage_V")
    else:
        raise ProtocolError(f"{_named(step, place)} has no PyBaMM string", place)
    until = step.get("until") or {}
    if not isinstance(until, Mapping):
        raise ProtocolError(f"{_named(step, place)}: ends in a list have no string", (*place, "until"))
    said = []
    for name, value in until.items():
        if name not in ends or isinstance(value, Mapping):
            raise ProtocolError(f"{_named(step, place)}: no string for this end", (*place, "until", name))
        number = _plain(until, name, (*place, "until"))
        said.append(f"for {_shown(number)} seconds" if name == "time_s" else f"until {_with_unit(name, number)}")
    return f"{head} {' or '.join(sorted(said))}"


def _plain(data: Mapping[str, Any], name: str, place: Where) -> float:
    fields = Fields({name: data[name]}, place)
    value = fields.rate(name) if name == "rate_C" else fields.number(name)
    return value or 0.0


def _with_unit(name: str, value: float) -> str:
    return f"{_shown(value)}C" if name == "rate_C" else f"{_shown(value)} {name.rsplit('_', 1)[1]}"


def _shown(value: float) -> str:
    """Write a number so that it is read back the same, without an exponent where that can be."""
    text = repr(float(value))
    return text.removesuffix(".0")


def _named(step: Mapping[str, Any], place: Where) -> str:
    numbers = ".".join(str(each + 1) for each in place if isinstance(each, int))
    return f"step {numbers} ({step['step']})"
