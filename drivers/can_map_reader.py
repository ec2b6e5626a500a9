"""From the tables of a CAN device map to frozen values; whether they fit the DBC is checked in `can_map_checks`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import cast

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


def read_can_map(file: Path, content: Mapping[str, object]) -> CanMap:
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
        capabilities=capabilities.intervals(("current", "voltage", "watchdog"), constants),
        asks=top.table("ask").named(lambda name, table: _ask(name, table, constants)),
        commands=top.table("command").named(lambda name, table: _command(name, table, constants)),
        roles=top.table("role").named(lambda name, table: _role(name, table, constants)),
        status=_flags(top.table("status")),
        alarms=_flags(top.table("alarms")),
        sequences={key: tuple(_step(table) for table in sequence.tables(key)) for key in SEQUENCES},
        unlimited_ramp=top.take("unlimited_ramp", float, None),
        no_hold=top.take("no_hold", float, None),
        refusal=_refusal(refusal),
        token=MappingProxyType(cast(dict[str, str], top.table("token").values())),
        shared=top.names("shared"),
        views=top.table("view").named(_view),
        frames=tuple(_frame(table) for table in top.tables("frame")),
    )
    for table in (identity, capabilities, sequence, refusal, top):
        table.finish()
    return result


def _signal(table: Table, key: str) -> SignalName:
    return _parsed(table, key, table.take(key, str))


def _parsed(table: Table, key: str, text: object) -> SignalName:
    message, _, signal = text.partition(".") if isinstance(text, str) else ("", "", "")
    if not message or not signal:
        table.fail(key, f"must be written Message.Signal, not {text!r}")
    return SignalName(message, signal)


def _signals(table: Table) -> Mapping[str, SignalName]:
    return MappingProxyType({key: _parsed(table, key, text) for key, text in table.values().items()})


def _send(table: Table, constants: Mapping[str, SignalName]) -> Send:
    message, values = table.take("send", str), table.table("values")
    names = ARGUMENTS | set(constants)
    expressions = {signal: values.needed_expression(signal, names) for signal in values.keys()}
    return Send(message, MappingProxyType(expressions), table.integer("length", 1, 64, None))


def _view(_name: str, table: Table) -> View:
    told = table.table("where").values()
    where = {signal: value for signal, value in told.items() if type(value) is int}
    if not where or len(where) < len(told):
        table.fail("where", f"must name signals and the whole raw numbers that they have, not {told!r}")
    return View(table.take("message", str), MappingProxyType(where), table.integer("length", 1, 64, None))


def _identity(table: Table) -> tuple[float, ...]:
    value = table.any_value("equals")
    if value == "node":
        return ()
    values: list[object] = value if isinstance(value, list) else [value]
    numbers = [number for number in values if isinstance(number, int | float) and not isinstance(number, bool)]
    if not numbers or len(numbers) < len(values):
        reason = f'must be a number, a list of numbers, or "node" for the node\'s own number, not {value!r}'
        table.fail("equals", reason)
    return tuple(float(number) for number in numbers)


def _ask(name: str, table: Table, constants: Mapping[str, SignalName]) -> Ask:
    ask = Ask(name, _send(table, constants), table.names("replies"))
    if not ask.replies:
        table.fail("replies", "must name at least one message")
    return ask


def _command(name: str, table: Table, constants: Mapping[str, SignalName]) -> Command:
    return Command(
        name=name,
        send=_send(table, constants),
        echo=table.take("echo", str, None),
        ask=table.take("ask", str, None),
        same=table.names("same"),
    )


def _role(name: str, table: Table, constants: Mapping[str, SignalName]) -> Role:
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


def _flag(table: Table, key: str, value: object) -> Flag:
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
    arguments: dict[str, float] = {}
    for name, value in table.values().items():
        if name not in ARGUMENTS or not isinstance(value, int | float):
            table.fail(name, f"must be one of {', '.join(sorted(ARGUMENTS))} and a number, true or false")
        arguments[name] = float(value)
    return Step(command, MappingProxyType(arguments))


def _refusal(table: Table) -> Refusal | None:
    if not table.keys():
        return None
    name, reasons = _signal(table, "code"), dict[int, str]()
    for code, text in table.table("reasons").values().items():
        if not code.isdecimal() or not isinstance(text, str):
            table.fail("reasons", "must be texts by decimal code")
        reasons[int(code)] = text
    return Refusal(name, MappingProxyType(reasons))


def _frame(table: Table) -> CanFrame:
    values: dict[str, float] = {}
    for name, value in table.table("values").values().items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            table.fail(f"values.{name}", f"must be a number, not {value!r}")
        values[name] = value
    frame = CanFrame(
        meaning=table.take("meaning", str),
        message=table.take("message", str),
        id=table.integer("id", 0, 0x1FFFFFFF),
        data=table.hexadecimal("data"),
        values=MappingProxyType(values),
    )
    table.finish()
    return frame
