"""The JSON schema of device maps, for editors; made of the same lists that the readers use.

A schema says what a map may hold; whether its parts fit together only the readers know (`bench-service maps check`).
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.can_map import ARGUMENTS, ROLES
from drivers.can_map import SEQUENCES as CAN_SEQUENCES
from drivers.device_map import COIL_ROLES, REGISTER_ROLES, TYPE_WORDS
from drivers.map_reader import KNOWN_FUNCTIONS, SCHEMA, SEQUENCES

Schema = Mapping[str, object]  # one node of a JSON schema

_TEXT: Schema = {"type": "string"}
_NUMBER: Schema = {"type": "number"}
_TIME: Schema = {"type": "number", "minimum": 0}
_FLAG: Schema = {"type": "boolean"}
_HEX: Schema = {"type": "string", "pattern": "^[0-9A-Fa-f ]*$"}
_EXPRESSION: Schema = {
    "description": "a number, or arithmetic of numbers, names from [const] and + - * / ( )",
    "type": ["string", "number"],
    "maxLength": 200,
}
_INTERVAL: Schema = {"type": "array", "items": _EXPRESSION, "minItems": 2, "maxItems": 2}
_SIGNAL: Schema = {"type": "string", "pattern": r"^\w+\.\w+$", "description": "Message.Signal of the DBC file"}
_ACCESS = {"enum": ["r", "w", "rw"]}
_SPACE = {"enum": ["holding", "input"]}


def map_schema() -> Schema:
    """Return the schema of all kinds of maps, as JSON Schema 2020-12."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Device map of a battery cycler, or of a temperature chamber",
        "oneOf": [_modbus(), _can(), _chamber()],
    }


def _object(required: tuple[str, ...] = (), **properties: Schema) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def _table_of(entry: Schema) -> Schema:
    return {"type": "object", "additionalProperties": entry}


def _whole(low: int, high: int) -> Schema:
    return {"type": "integer", "minimum": low, "maximum": high}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


_HEAD: Mapping[str, Schema] = {
    "schema": {"const": SCHEMA},
    "name": _TEXT,
    "title": _TEXT,
    "source": {**_TEXT, "description": "manual, edition, page; and whether it has run on hardware"},
    "verified_on_hardware": _FLAG,
    "min_gap_s": _TIME,
    "worst_reply_s": _TIME,
    "positive_current": {"enum": ["charge", "discharge"]},
}
_ADDRESS = _whole(0, 0xFFFF)
_NEEDED = ("schema", "name", "title", "source", "verified_on_hardware", "transport", "positive_current", "identity")


_NEEDED_MODBUS = ("unit_id", "word_order", "functions", "reg", "sequence")


def _modbus() -> Schema:
    own = {"kind": {"const": "cycler"}, "capabilities": _object(current=_INTERVAL, voltage=_INTERVAL)}
    return _object((*_NEEDED, *_NEEDED_MODBUS), **_HEAD, **_registers(), **own)


def _chamber() -> Schema:
    """A chamber has no current, and says what it is."""
    needed = tuple(key for key in _NEEDED if key != "positive_current")
    head = {key: value for key, value in _HEAD.items() if key != "positive_current"}
    own = {"kind": {"const": "chamber"}, "capabilities": _object(temperature=_INTERVAL)}
    return _object(("kind", *needed, *_NEEDED_MODBUS), **head, **_registers(), **own)


def _registers() -> Mapping[str, Schema]:
    """What a map has that is reached over Modbus."""
    step = _object(("write", "value"), write=_TEXT, value={"type": ["number", "boolean", "string"]})
    scalar = {"type": ["number", "string"]}
    return dict(
        transport={"const": "modbus"},
        unit_id=_whole(0, 255),
        word_order={"enum": ["big", "little"]},
        functions=_list({"enum": sorted(KNOWN_FUNCTIONS)}),
        max_read_registers=_whole(1, 125),
        single_writes=_FLAG,
        alarm_bits=_list(_TEXT),
        identity=_object(("register", "equals"), register=_TEXT, equals={"anyOf": [scalar, _list(scalar)]}),
        const=_table_of(_TEXT),
        block=_list(_object(("first", "last"), space=_SPACE, first=_ADDRESS, last=_ADDRESS, one_type=_FLAG)),
        reg=_table_of(_register()),
        coil=_table_of(
            _object(("address", "access"), address=_ADDRESS, access=_ACCESS, role={"enum": sorted(COIL_ROLES)})
        ),
        bits=_table_of(_table_of(_whole(0, 31))),
        sequence=_object(("safe",), **{name: _list(step) for name in SEQUENCES}),
        frame=_list(_modbus_frame()),
    )


def _register() -> Schema:
    return _object(
        ("address", "type", "access"),
        address=_ADDRESS,
        type={"enum": [*TYPE_WORDS, "string"]},
        length=_whole(1, 125),
        space=_SPACE,
        access=_ACCESS,
        word_order={"enum": ["big", "little"]},
        unit=_TEXT,
        role={"enum": sorted(REGISTER_ROLES)},
        scale=_EXPRESSION,
        range=_INTERVAL,
        raw_max=_whole(0, 0xFFFFFFFF),
        invalid=_list({"type": "integer", "minimum": 0}),
        unlimited=_NUMBER,
        verify={"type": "string", "pattern": r"^(none|echo|readback(:\w+)?)$"},
        negative=_TEXT,
    )


def _modbus_frame() -> Schema:
    return _object(
        ("meaning", "request", "reply"),
        meaning=_TEXT,
        request=_HEX,
        reply=_HEX,
        values=_table_of({"type": ["number", "boolean", "string"]}),
        missing=_list(_TEXT),
    )


def _can() -> Schema:
    length = _whole(1, 64)
    send = {"send": _TEXT, "values": _table_of(_EXPRESSION), "length": length}
    view = _object(("message", "where"), message=_TEXT, where=_table_of({"type": "integer"}), length=length)
    chosen = _object(("signal",), **{"signal": _SIGNAL, "is": _list({"type": "integer"}), "bit": _whole(0, 63)})
    flag = {"anyOf": [_SIGNAL, chosen]}
    role = _object(("signal",), signal=_SIGNAL, scale=_EXPRESSION, invalid=_list(_NUMBER), negative=flag)
    arguments = dict.fromkeys(sorted(ARGUMENTS), {"type": ["number", "boolean"]})
    return _object(
        (*_NEEDED, "dbc", "command", "role", "status", "sequence"),
        **_HEAD,
        transport={"const": "can"},
        dbc=_TEXT,
        fd=_FLAG,
        node_step=_whole(0, 0x1FFFFFFF),
        max_age_s=_TIME,
        execution_s=_TIME,
        unlimited_ramp=_NUMBER,
        no_hold=_NUMBER,
        shared=_list(_TEXT),
        view=_table_of(view),
        identity=_object(
            ("signal", "equals"), signal=_SIGNAL, equals={"anyOf": [_NUMBER, _list(_NUMBER), {"const": "node"}]}
        ),
        const=_table_of(_SIGNAL),
        capabilities=_object(current=_INTERVAL, voltage=_INTERVAL, watchdog=_INTERVAL),
        token=_table_of(_TEXT),
        ask=_table_of(_object(("send", "replies"), **send, replies=_list(_TEXT))),
        command=_table_of(_object(("send",), **send, echo=_TEXT, ask=_TEXT, same=_list(_TEXT))),
        refusal=_object(("code",), code=_SIGNAL, reasons=_table_of(_TEXT)),
        role=_object(("actual_voltage", "actual_current"), **dict.fromkeys(sorted(ROLES), role)),
        status=_table_of(flag),
        alarms=_table_of(flag),
        sequence=_object(
            ("tick", "output", "safe"),
            **{name: _list(_object(("command",), command=_TEXT, **arguments)) for name in CAN_SEQUENCES},
        ),
        frame=_list(_can_frame()),
    )


def _can_frame() -> Schema:
    return _object(
        ("meaning", "message", "id", "data"),
        meaning=_TEXT,
        message=_TEXT,
        id=_whole(0, 0x1FFFFFFF),
        data=_HEX,
        values=_table_of(_NUMBER),
    )
