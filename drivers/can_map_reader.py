"""From the tables of a CAN device map to frozen values; whether they fit the DBC is checked in `can_map_checks`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from drivers.can_map import (
    ARGUMENTS,
    ROLES,
    SEQUENCES,
    Ask,
    CanFrame,
    CanMap,
    Command,
    Flag,
    Refusal,
    Role,
    Send,
    SignalName,
    Step,
    View,
)
from drivers.map_reader import SCHEMA
from drivers.map_table import Table

DEFAULT_WORST_REPLY_S = 0.2
DEFAULT_MAX_AGE_S = 0.5


def read_can_map(file: Path, content: Mapping[str, Any]) -> CanMap:
    """Build a map from parsed TOML.

    Raises
    ------
    BadMapError
        With file, dotted key and reason, at the first thing that is wrong on its own.
    """
    top = Table(file, "", content)
    if (schema := top.take("schema", int)) != SCHEMA:
        top.fail("schema", f"is {schema}; this version reads schema {SCHEMA}")
    top.choose("transport", ("can",))
    identity, capabilities, refusal = top.table("identity"), top.table("capabilities"), top.table("refusal")
    constants = _signals(top.table("const"))
    sequence = top.table("sequence")
    result = CanMap(
        file=file,
        name=top.take("name", str),
        title=top.take("title", str),
        source=top.take("source", str),
        verified_on_hardware=top.take("verified_on_hardware", bool),
        dbc=file.parent / top.take("dbc", str),
        fd=top.take("fd", bool, False),
        node_step=top.integer("node_step", 0, 0x1FFFFFFF, 0),
        min_gap_s=top.not_negative("min_gap_s", 0.0),
        worst_reply_s=top.not_negative("worst_reply_s", DEFAULT_WORST_REPLY_S),
        max_age_s=top.not_negative("max_age_s", DEFAULT_MAX_AGE_S),
        execution_s=top.not_negative("execution_s", 0.0),
        positive_current=top.choose("positive_current", ("charge", "discharge")),
        identity=(_signal(identity, "signal"), _identity(identity)),
        constants=constants,
        capabilities=_intervals(capabilities, constants),
        asks=_named(top.table("ask"), lambda name, table: _ask(name, table, constants)),
        commands=_named(top.table("command"), lambda name, table: _command(name, table, constants)),
        roles=_named(top.table("role"), lambda name, table: _role(name, table, constants)),
        status=_flags(top.table("status")),
        alarms=_flags(top.table("alarms")),
        sequences={key: tuple(_step(table) for table in sequence.tables(key)) for key in SEQUENCES},
        unlimited_ramp=top.take("unlimited_ramp", float, None),
        refusal=_refusal(refusal),
        token=MappingProxyType(top.table("token").values()),
        shared=_names(top, "shared"),
        views=_named(top.table("view"), _view),
        frames=tuple(_frame(table) for table in top.tables("frame")),
    )
    for table in (identity, capabilities, sequence, refusal, top):
        table.finish()
    return result


def _named(table: Table, build: Any) -> Mapping[str, Any]:
    """Build one value from each table of a table of tables."""
    result: dict[str, Any] = {}
    for name, child in table.children().items():
        result[name] = build(name, child)
        child.finish()
    return MappingProxyType(result)


def _signal(table: Table, key: str) -> SignalName:
    return _parsed(table, key, table.take(key, str))


def _parsed(table: Table, key: str, text: Any) -> SignalName:
    message, _, signal = text.partition(".") if isinstance(text, str) else ("", "", "")
    if not message or not signal:
        table.fail(key, f"must be written Message.Signal, not {text!r}")
    return SignalName(message, signal)


def _signals(table: Table) -> Mapping[str, SignalName]:
    return MappingProxyType({key: _parsed(table, key, text) for key, text in table.values().items()})


def _intervals(table: Table, names: Mapping[str, Any]) -> Mapping[str, Any]:
    found = {key: table.interval(key, names) for key in ("current", "voltage", "watchdog")}
    return MappingProxyType({key: value for key, value in found.items() if value is not None})


def _send(table: Table, constants: Mapping[str, Any]) -> Send:
    message, values = table.take("send", str), table.table("values")
    names = ARGUMENTS | set(constants)
    expressions = {signal: values.needed_expression(signal, names) for signal in values.keys()}
    return Send(message, MappingProxyType(expressions), table.integer("length", 1, 64, None))


def _view(_name: str, table: Table) -> View:
    where = table.table("where").values()
    if not where or any(type(value) is not int for value in where.values()):
        table.fail("where", f"must name signals and the whole raw numbers that they have, not {where!r}")
    return View(table.take("message", str), MappingProxyType(where), table.integer("length", 1, 64, None))


def _identity(table: Table) -> tuple[float, ...]:
    value = table.any_value("equals")
    if value == "node":
        return ()
    numbers = value if isinstance(value, list) else [value]
    if not numbers or any(type(number) not in (int, float) for number in numbers):
        reason = f'must be a number, a list of numbers, or "node" for the node\'s own number, not {value!r}'
        table.fail("equals", reason)
    return tuple(float(number) for number in numbers)


def _names(table: Table, key: str) -> tuple[str, ...]:
    names = table.take(key, list, [])
    if not all(isinstance(name, str) for name in names):
        table.fail(key, f"must be a list of names, not {names!r}")
    return tuple(names)


def _ask(name: str, table: Table, constants: Mapping[str, Any]) -> Ask:
    ask = Ask(name, _send(table, constants), _names(table, "replies"))
    if not ask.replies:
        table.fail("replies", "must name at least one message")
    return ask


def _command(name: str, table: Table, constants: Mapping[str, Any]) -> Command:
    return Command(
        name=name,
        send=_send(table, constants),
        echo=table.take("echo", str, None),
        ask=table.take("ask", str, None),
        same=_names(table, "same"),
    )


def _role(name: str, table: Table, constants: Mapping[str, Any]) -> Role:
    if name not in ROLES:
        table.fail("", f"is no role; roles are {', '.join(sorted(ROLES))}")
    invalid = table.take("invalid", list, [])
    if any(type(raw) not in (int, float) for raw in invalid):
        table.fail("invalid", f"must be a list of raw numbers, not {invalid!r}")
    return Role(
        name=_signal(table, "signal"),
        scale=table.expression("scale", constants),
        invalid=frozenset(invalid),
        negative=_flag(table, "negative", table.any_value("negative")) if "negative" in table.keys() else None,
    )


def _flags(table: Table) -> Mapping[str, Flag]:
    return MappingProxyType({key: _flag(table, key, value) for key, value in table.values().items()})


def _flag(table: Table, key: str, value: Any) -> Flag:
    if isinstance(value, str):
        return Flag(_parsed(table, key, value))
    inner = Table(table.file, f"{table.key}.{key}", value)
    values, bit = inner.integers("is", 0, (1 << 64) - 1, []), inner.integer("bit", 0, 63, None)
    if bool(values) == (bit is not None):
        inner.fail("is", "give either the raw values of the flag in 'is', or its 'bit'")
    flag = Flag(_signal(inner, "signal"), frozenset(values), bit)
    inner.finish()
    return flag


def _step(table: Table) -> Step:
    command = table.take("command", str)
    arguments = table.values()
    for name, value in arguments.items():
        if name not in ARGUMENTS or type(value) not in (int, float, bool):
            table.fail(name, f"must be one of {', '.join(sorted(ARGUMENTS))} and a number, true or false")
    return Step(command, MappingProxyType({name: float(value) for name, value in arguments.items()}))


def _refusal(table: Table) -> Refusal | None:
    if not table.keys():
        return None
    name, reasons = _signal(table, "code"), table.table("reasons").values()
    if not all(code.isdecimal() and isinstance(text, str) for code, text in reasons.items()):
        table.fail("reasons", "must be texts by decimal code")
    return Refusal(name, MappingProxyType({int(code): text for code, text in reasons.items()}))


def _frame(table: Table) -> CanFrame:
    values = table.table("values").values()
    for name, value in values.items():
        if type(value) not in (int, float):
            table.fail(f"values.{name}", f"must be a number, not {value!r}")
    frame = CanFrame(
        meaning=table.take("meaning", str),
        message=table.take("message", str),
        id=table.integer("id", 0, 0x1FFFFFFF),
        data=table.hexadecimal("data"),
        values=MappingProxyType(values),
    )
    table.finish()
    return frame
