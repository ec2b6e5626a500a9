"""From the tables of a device map to frozen values; what belongs together is checked in `map_checks`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal, cast

from drivers.device_map import (
    COIL_ROLES,
    REGISTER_ROLES,
    TYPE_WORDS,
    Block,
    Coil,
    DeviceMap,
    Frame,
    Identity,
    Kind,
    Register,
    Step,
    Transport,
    Verify,
    WordOrder,
)
from drivers.map_table import Table

SCHEMA = 1
DEFAULT_WORST_REPLY_S = 0.5
SEQUENCES = ("acquire", "safe", "release", "clear_fault")
_CAPABILITIES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"cycler": ("current", "voltage"), "chamber": ("temperature",)}
)
KINDS: tuple[Kind, ...] = ("cycler", "chamber")
KNOWN_FUNCTIONS = frozenset((1, 3, 4, 5, 6, 15, 16, 23))


def read_device_map(file: Path, content: Mapping[str, object]) -> DeviceMap:
    """Build a map from parsed TOML.

    Raises
    ------
    BadMapError
        With file, dotted key and reason, at the first thing that is wrong on its own.
    """
    top = Table(file, "", content)
    if (schema := top.take("schema", int)) != SCHEMA:
        top.fail("schema", f"is {schema}; this version reads schema {SCHEMA}")
    transport: Transport = top.choose("transport", ("modbus",))
    identity = top.table("identity")
    constants = cast(Mapping[str, str], top.table("const").values())  # `map_checks` looks at each
    capabilities = top.table("capabilities")
    word_order: WordOrder = top.choose("word_order", ("big", "little"))
    kind: Kind = top.choose("kind", KINDS, "cycler")
    result = DeviceMap(
        file=file,
        name=top.take("name", str),
        title=top.take("title", str),
        source=top.take("source", str),
        kind=kind,
        verified_on_hardware=top.take("verified_on_hardware", bool),
        transport=transport,
        unit_id=top.integer("unit_id", 0, 255),
        word_order=word_order,
        functions=_functions(top),
        min_gap_s=top.not_negative("min_gap_s", 0.0),
        worst_reply_s=top.not_negative("worst_reply_s", DEFAULT_WORST_REPLY_S),
        max_read_registers=top.integer("max_read_registers", 1, 125, 125),
        single_writes=top.take("single_writes", bool, False),
        positive_current=_positive_current(top, kind),
        identity=Identity(identity.take("register", str), _scalars(identity, "equals")),
        constants=MappingProxyType(constants),
        capabilities=capabilities.intervals(_CAPABILITIES[kind], constants),
        blocks=tuple(_block(table) for table in top.tables("block")),
        registers=top.table("reg").named(lambda name, table: _register(name, table, word_order, constants)),
        coils=top.table("coil").named(_coil),
        bits=top.table("bits").named(_bits),
        alarm_bits=top.names("alarm_bits"),
        sequences=_sequences(top.table("sequence")),
        frames=tuple(_frame(table) for table in top.tables("frame")),
    )
    for table in (identity, capabilities, top):
        table.finish()
    return result


def _positive_current(top: Table, kind: Kind) -> Literal["charge", "discharge"]:
    """Take the sign of the current; a chamber has none."""
    return "charge" if kind == "chamber" else top.choose("positive_current", ("charge", "discharge"))


def _functions(top: Table) -> frozenset[int]:
    functions = top.integers("functions", 1, 127)
    unknown = sorted(set(functions) - KNOWN_FUNCTIONS)
    if unknown:
        top.fail("functions", f"{unknown} are not supported; known are {sorted(KNOWN_FUNCTIONS)}")
    return frozenset(functions)


def _scalars(table: Table, key: str) -> tuple[float | str, ...]:
    """Take a number, a string, or a list of such."""
    value = table.any_value(key)
    values: list[object] = value if isinstance(value, list) else [value]
    known = tuple(part for part in values if isinstance(part, int | float | str) and not isinstance(part, bool))
    if not known or len(known) < len(values):
        table.fail(key, f"must be a number or a string, or a list of such, not {value!r}")
    return known


def _block(table: Table) -> Block:
    first = table.integer("first", 0, 0xFFFF)
    block = Block(
        space=table.choose("space", ("holding", "input"), "holding"),
        first=first,
        last=table.integer("last", first, 0xFFFF),
        one_type=table.take("one_type", bool, False),
    )
    table.finish()
    return block


def _register(name: str, table: Table, word_order: WordOrder, constants: Mapping[str, str]) -> Register:
    kind = table.choose("type", (*TYPE_WORDS, "string"))
    words = table.integer("length", 1, 125) if kind == "string" else TYPE_WORDS[kind]
    register = Register(
        name=name,
        address=table.integer("address", 0, 0x10000 - words),
        type=kind,
        words=words,
        space=table.choose("space", ("holding", "input"), "holding"),
        access=table.choose("access", ("r", "w", "rw")),
        word_order=table.choose("word_order", ("big", "little"), word_order),
        unit=table.take("unit", str, ""),
        role=table.choose("role", REGISTER_ROLES, None),
        scale=table.expression("scale", constants),
        range=table.interval("range", constants),
        raw_max=table.integer("raw_max", 0, 0xFFFFFFFF, None),
        invalid=table.integers("invalid", 0, (1 << 16 * words) - 1, []),
        unlimited=table.take("unlimited", float, None),
        verify=_verify(table),
        negative=table.take("negative", str, None),
    )
    if kind == "string" and (register.scale or register.range or register.invalid or register.raw_max is not None):
        table.fail("type", "a string has no scale, range, invalid or raw_max")
    if kind in ("f32", "f64") and register.raw_max is not None:
        table.fail("raw_max", "is for whole-number types; use range")
    if register.space == "input" and register.writable:
        table.fail("access", "input registers cannot be written")
    return register


def _verify(table: Table) -> Verify:
    text = table.take("verify", str, "none")
    kind, _, register = text.partition(":")
    if kind not in ("none", "echo", "readback") or (register and kind != "readback"):
        table.fail("verify", f"must be none, echo, readback or readback:REGISTER, not {text!r}")
    return Verify(kind, register or None)


def _coil(name: str, table: Table) -> Coil:
    return Coil(
        name=name,
        address=table.integer("address", 0, 0xFFFF),
        access=table.choose("access", ("r", "w", "rw")),
        role=table.choose("role", COIL_ROLES, None),
    )


def _bits(_name: str, table: Table) -> Mapping[str, int]:
    bits: dict[str, int] = {}
    for bit, position in table.values().items():
        if type(position) is not int or not 0 <= position <= 31:
            table.fail(bit, f"must be a bit position within 0 and 31, not {position!r}")
        bits[bit] = position
    if len(set(bits.values())) != len(bits):
        table.fail("", "two names have the same bit position")
    return MappingProxyType(bits)


def _sequences(table: Table) -> Mapping[str, tuple[Step, ...]]:
    result = {key: tuple(_step(step) for step in table.tables(key)) for key in SEQUENCES}
    table.finish()
    if not result["safe"]:
        table.fail("safe", "is missing; every device must have a way to rest with its output off")
    return MappingProxyType(result)


def _step(table: Table) -> Step:
    write = table.take("write", str)
    value = table.any_value("value")
    if isinstance(value, str):
        if not value.startswith("$"):
            table.fail("value", f"must be a number, true, false or $NAME, not {value!r}")
        step = Step(write, None, value[1:])
    elif isinstance(value, int | float):  # true and false are whole numbers too
        step = Step(write, value)
    else:
        table.fail("value", f"must be a number, true, false or $NAME, not {value!r}")
    table.finish()
    return step


def _frame(table: Table) -> Frame:
    values: dict[str, float | bool | str] = {}
    for name, value in table.table("values").values().items():
        if not isinstance(value, int | float | str):
            table.fail(f"values.{name}", f"must be a number, a string, true or false, not {value!r}")
        values[name] = value
    missing = table.take("missing", list, [])
    frame = Frame(
        meaning=table.take("meaning", str),
        request=table.hexadecimal("request"),
        reply=table.hexadecimal("reply"),
        values=MappingProxyType(values),
        missing=tuple(missing),
    )
    table.finish()
    return frame
