"""Does a CAN map hold together with its DBC: every name points somewhere, and no message goes both ways."""

from __future__ import annotations

from typing import NoReturn

from drivers.can_codec import CanCodec
from drivers.can_map import CanMap, Send
from drivers.errors import BadMapError, CyclerError
from drivers.expression import Expression, ExpressionError

NEEDED_ROLES = ("actual_voltage", "actual_current")
SETPOINTS = frozenset(("set_current", "charge", "discharge"))
TRANSPORT_BYTES = {False: 8, True: 64}


def check_can_map(can_map: CanMap) -> CanCodec:
    """Check everything that more than one key, or the DBC, is needed for; return the DBC's codec.

    Raises
    ------
    BadMapError
        At the first contradiction.
    """
    codec = CanCodec(can_map.dbc, can_map.views)
    _check_views(can_map, codec)
    _check_messages(can_map, codec)
    _check_signals(can_map, codec)
    _check_commands(can_map, codec)
    _check_sequences(can_map)
    _check_frames(can_map, codec)
    return codec


def _fail(can_map: CanMap, key: str, reason: str) -> NoReturn:
    raise BadMapError(can_map.file, key, reason)


def _sends(can_map: CanMap) -> list[tuple[str, Send]]:
    found = [(f"ask.{ask.name}", ask.send) for ask in can_map.asks.values()]
    return found + [(f"command.{command.name}", command.send) for command in can_map.commands.values()]


def _check_views(can_map: CanMap, codec: CanCodec) -> None:
    """Views are of messages that are there, under names of their own."""
    for name, view in can_map.views.items():
        layout = codec.message(view.message)
        if layout is None or view.message in can_map.views:
            _fail(can_map, f"view.{name}.message", f"{can_map.dbc.name} has no message '{view.message}'")
        if codec.is_message(name):
            _fail(can_map, f"view.{name}", f"{can_map.dbc.name} has a message of that name")
        for signal in view.where:
            if not codec.has_signal(view.message, signal):
                _fail(can_map, f"view.{name}.where.{signal}", f"message '{view.message}' has no such signal")


def _check_messages(can_map: CanMap, codec: CanCodec) -> None:
    """Messages exist, fit the bus, and are either the bench's or the device's."""
    sent = {send.message for _, send in _sends(can_map)}
    named = [(f"{key}.send", send.message) for key, send in _sends(can_map)]
    for ask in can_map.asks.values():
        named += [(f"ask.{ask.name}.replies", reply) for reply in ask.replies]
    named += [(f"command.{c.name}.echo", c.echo) for c in can_map.commands.values() if c.echo]
    named += [(key, signal.message) for key, signal in can_map.signals()]
    for key, name in named:
        layout = codec.message(name)
        if layout is None:
            _fail(can_map, key, f"names message '{name}', which {can_map.dbc.name} does not have")
        if layout.length > TRANSPORT_BYTES[can_map.fd]:
            _fail(can_map, key, f"message '{name}' has {layout.length} bytes; longer than 8 needs fd = true")
        if not codec.is_settled(name):
            _fail(can_map, key, f"message '{name}' is multiplexed; name a [view] of it that gives the multiplexer")
        if can_map.base(name) in sent and name not in can_map.shared and not key.endswith(".send"):
            reason = f"message '{name}' is sent by the bench; where the device answers with it too, name it in 'shared'"
            _fail(can_map, key, reason)


def _check_signals(can_map: CanMap, codec: CanCodec) -> None:
    """Signals exist; what every cycler needs is there."""
    for key, signal in can_map.signals():
        if not codec.has_signal(signal.message, signal.signal):
            _fail(can_map, key, f"names '{signal}', which {can_map.dbc.name} does not have")
    for role in NEEDED_ROLES:
        if role not in can_map.roles:
            _fail(can_map, "role", f"there is no role '{role}', which every cycler needs")
    if "output_on" not in can_map.status:
        _fail(can_map, "status", "needs a flag 'output_on': the output is verified by it")
    for name in (can_map.identity[0], *can_map.constants.values()):
        if can_map.ask_for(name.message) is None:
            _fail(can_map, "ask", f"no question is answered with '{name.message}', which connecting needs")
    for name in can_map.constants:
        if not name.isidentifier():
            _fail(can_map, f"const.{name}", "must be a name that an expression can use")


def _check_commands(can_map: CanMap, codec: CanCodec) -> None:
    """Values go into signals that are there; echoes can be asked for and compared."""
    for key, send in _sends(can_map):
        for signal, expression in send.values.items():
            if not codec.has_signal(send.message, signal):
                _fail(can_map, f"{key}.values.{signal}", f"message '{send.message}' has no such signal")
            if not expression.names:
                _checked_constant(can_map, codec, f"{key}.values.{signal}", send.message, signal, expression)
    for command in can_map.commands.values():
        key = f"command.{command.name}"
        if command.ask is not None and command.ask not in can_map.asks:
            _fail(can_map, f"{key}.ask", f"there is no question '{command.ask}'")
        if command.ask is not None and command.echo not in can_map.asks[command.ask].replies:
            _fail(can_map, f"{key}.echo", f"question '{command.ask}' is not answered with {command.echo!r}")
        for signal in command.same:
            if not (codec.has_signal(command.send.message, signal) and codec.has_signal(command.echo or "", signal)):
                _fail(can_map, f"{key}.same", f"'{signal}' is not in both the command and its echo")


def _checked_constant(can_map: CanMap, codec: CanCodec, key: str, message: str, signal: str, value: Expression) -> None:
    try:
        codec.encode(message, {signal: value.evaluate({})})
    except (CyclerError, ExpressionError) as error:
        _fail(can_map, key, str(error))


def _check_sequences(can_map: CanMap) -> None:
    """Steps name commands; every tick sets the current, safe switches the output off, and what is held can be ended."""
    for sequence, steps in can_map.sequences.items():
        for index, step in enumerate(steps):
            if step.command not in can_map.commands:
                _fail(can_map, f"sequence.{sequence}[{index}].command", f"there is no command '{step.command}'")
    needs = {"tick": set(SETPOINTS), "output": {"output"}, "safe": {"output"}}
    if can_map.sequences["hold"]:
        needs["hold"] = {"hold_voltage"}
        if can_map.no_hold is None:
            _fail(can_map, "no_hold", "is missing: what to send in sequence.hold for no voltage to be held")
    for sequence, needed in needs.items():
        used: set[str] = set()
        for step in can_map.sequences[sequence]:
            values = can_map.commands[step.command].send.values.values()
            used |= {name for expression in values for name in expression.names}
        if not used & needed:
            reason = f"must send {' or '.join(sorted(needed))}, or the device would not be told"
            _fail(can_map, f"sequence.{sequence}", reason)
    if any(step.arguments.get("output", 0.0) != 0.0 for step in can_map.sequences["safe"]):
        _fail(can_map, "sequence.safe", "switches the output on; safe means output off")


def _check_frames(can_map: CanMap, codec: CanCodec) -> None:
    """Sample frames speak of messages and signals that are there."""
    for index, frame in enumerate(can_map.frames):
        key, layout = f"frame[{index}]", codec.message(frame.message)
        if layout is None:
            _fail(can_map, f"{key}.message", f"{can_map.dbc.name} has no message '{frame.message}'")
        if layout.frame_id != frame.id:
            _fail(can_map, f"{key}.id", f"is 0x{frame.id:X}; the DBC says 0x{layout.frame_id:X}")
        for name in frame.values:
            if not codec.has_signal(frame.message, name):
                _fail(can_map, f"{key}.values.{name}", f"message '{frame.message}' has no such signal")
