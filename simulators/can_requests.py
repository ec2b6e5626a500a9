"""What a CAN message of the bench means, read off the map's questions and commands.

A signal whose value there is one argument plays that argument's part, and a signal with a fixed number selects the
question or the command.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.register_map import Ask, CanMap, Command, Send
from simulators.can_dbc import Layout

__all__ = ["Asked", "CanRequests", "Told"]


@dataclass(frozen=True, slots=True)
class Asked:
    """A question with its arguments."""

    ask: Ask
    arguments: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Told:
    """A command with its arguments, current in the device's own sign."""

    command: Command
    arguments: Mapping[str, float]


class CanRequests:
    """Reads the messages of the bench.

    Parameters
    ----------
    can_map : CanMap
    layouts : mapping of str to Layout
    constants : mapping of str to float
        Of the map's expressions.
    """

    def __init__(self, can_map: CanMap, layouts: Mapping[str, Layout], constants: Mapping[str, float]) -> None:
        self._map, self._layouts, self._constants = can_map, layouts, constants
        sends = [command.send for command in can_map.commands.values()] + [ask.send for ask in can_map.asks.values()]
        told = [layouts[send.message] for send in sends]
        self._told = {(layout.id, layout.extended): layout for layout in told}
        self._lengths = {(send.message, send.length or layout.length) for send, layout in zip(sends, told, strict=True)}

    def layout_of(self, identifier: int, *, extended: bool) -> Layout | None:
        """Return the message that the bench sends under an identifier of node 0."""
        return self._told.get((identifier, extended))

    def takes(self, layout: Layout, length: int) -> bool:
        """Whether a message of the bench may be so long."""
        return (layout.name, length) in self._lengths

    def read(self, message: str, raws: Mapping[str, float], length: int) -> Asked | Told | None:
        """Return what a message asks or tells; None if the map has no such thing."""
        values = {name: self._physical(message, name, raw) for name, raw in raws.items()}
        for ask in self._map.asks.values():
            if (arguments := self._arguments(ask.send, message, values, length)) is not None:
                return Asked(ask, arguments)
        for command in self._map.commands.values():
            if (arguments := self._arguments(command.send, message, values, length)) is not None:
                return Told(command, arguments)
        return None

    def _physical(self, message: str, name: str, raw: float) -> float:
        signal = self._layouts[message].signals[name]
        return raw if signal.floating else raw * signal.factor + signal.offset

    def _arguments(self, send: Send, message: str, values: Mapping[str, float], length: int) -> dict[str, float] | None:
        """Return the arguments that a message carries; None if it is another one, or its fixed numbers are others."""
        if send.message != message or length != (send.length or self._layouts[message].length):
            return None
        arguments: dict[str, float] = {}
        for signal, expression in send.values.items():
            names = expression.names - set(self._constants)
            at = dict(self._constants) | dict.fromkeys(names, 0.0)
            zero = expression.evaluate(at)
            if not names:
                if values[signal] != zero:
                    return None
                continue
            (name,) = names
            slope = expression.evaluate(at | {name: 1.0}) - zero
            arguments[name] = (values[signal] - zero) / slope
        return arguments
