"""CAN messages <-> signal values, after a DBC file. Pure; the file is read once."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from pathlib import Path

from drivers.can_map import View
from drivers.errors import BadMapError, CyclerProtocolError, SetPointRefusedError
from drivers.python_can import CantoolsError, Database, Message, cantools

Raws = Mapping[str, float]


class CanCodec:
    """The messages of one DBC file.

    Parameters
    ----------
    dbc : Path
    views : mapping
        More names for messages, see `drivers.can_map.View`; those of messages that there are not are left out.

    Raises
    ------
    BadMapError
        If the file cannot be read.
    """

    def __init__(self, dbc: Path, views: Mapping[str, View] | None = None) -> None:
        try:
            database = cantools.database.load_file(dbc, strict=True)
        except FileNotFoundError:
            raise BadMapError(dbc, "(file)", "does not exist; the map's key 'dbc' names it") from None
        except (OSError, UnicodeDecodeError, CantoolsError, ValueError) as error:
            raise BadMapError(dbc, "(file)", f"cannot be read as DBC: {error}") from error
        if not isinstance(database, Database):
            raise BadMapError(dbc, "(file)", "is a database of another kind")
        self._messages: dict[str, Message] = {message.name: message for message in database.messages}
        self._own = frozenset(self._messages)
        self._views = {name: view for name, view in (views or {}).items() if view.message in self._messages}
        self._messages |= {name: self._messages[view.message] for name, view in self._views.items()}

    def message(self, name: str) -> Message | None:
        """Return a message's layout, None if there is no such message."""
        return self._messages.get(name)

    def is_message(self, name: str) -> bool:
        """Whether the DBC itself has a message of that name."""
        return name in self._own

    def identifiers(self, names: Collection[str]) -> dict[str, int]:
        """Return the identifiers of some messages."""
        return {name: self._messages[name].frame_id for name in names}

    def has_signal(self, message: str, signal: str) -> bool:
        """Whether a message has a signal; a view of a multiplexed one only those that stand there with its values."""
        layout, view = self._messages.get(message), self._views.get(message)
        if layout is None:
            return False
        where: Mapping[str, int] = {} if view is None else view.where
        return any(
            found.name == signal
            and (found.multiplexer_ids is None or where.get(found.multiplexer_signal or "") in found.multiplexer_ids)
            for found in layout.signals
        )

    def is_settled(self, message: str) -> bool:
        """Whether it is known which signals a message has: it is not multiplexed, or a view that says which."""
        layout, view = self._messages[message], self._views.get(message)
        where: Mapping[str, int] = {} if view is None else view.where
        return all(found.name in where for found in layout.signals if found.is_multiplexer)

    def encode(self, name: str, values: Mapping[str, float]) -> bytes:
        """Encode physical values; signals without a value are zero.

        Raises
        ------
        SetPointRefusedError
            If a value is not finite or does not fit its signal.
        """
        layout = self._messages[name]
        data: dict[str, float] = {}
        for signal in layout.signals:
            if signal.multiplexer_ids is not None and signal.name not in values:
                continue
            value = values.get(signal.name, 0.0)
            if not math.isfinite(value):
                raise SetPointRefusedError(f"message '{name}': {signal.name} = {value} is no finite number; not sent")
            data[signal.name] = int(value) if float(value).is_integer() else value
        try:
            return layout.encode(data, scaling=True, padding=False, strict=True)
        except (CantoolsError, ValueError, OverflowError) as error:
            raise SetPointRefusedError(f"message '{name}': {error}; not sent") from error

    def raw(self, name: str, data: bytes) -> dict[str, float]:
        """Return the raw value of every signal in a message.

        Raises
        ------
        CyclerProtocolError
            If the message is too short.
        """
        layout, view = self._messages[name], self._views.get(name)
        if view is not None and len(data) >= (view.length or layout.length):
            data = data.ljust(layout.length, b"\0")  # an answer may be shorter than the longest of its kind
        try:
            decoded = layout.decode_simple(data, decode_choices=False, scaling=False)
        except (CantoolsError, ValueError) as error:
            raise CyclerProtocolError(f"message '{name}' with data {data.hex(' ')}: {error}") from error
        return {signal: float(value) for signal, value in decoded.items()}  # pyright: ignore[reportArgumentType]

    def view_of(self, name: str, data: bytes) -> str:
        """Return the name of the view that a frame of a message is; the message's own where it is none."""
        for view_name, view in self._views.items():
            if view.message == name and len(data) >= (view.length or self._messages[name].length):
                raws = self.raw(view_name, data)
                if all(raws[signal] == value for signal, value in view.where.items()):
                    return view_name
        return name

    def physical(self, name: str, raws: Raws) -> dict[str, float]:
        """Physical values of raw ones, by the DBC's factor and offset."""
        signals = {signal.name: signal for signal in self._messages[name].signals}
        return {key: float(signals[key].raw_to_scaled(raw, decode_choices=False)) for key, raw in raws.items()}  # pyright: ignore[reportArgumentType]

    def resolution(self, message: str, signal: str) -> float:
        """Step of a signal's physical value."""
        found = self._messages[message].get_signal_by_name(signal)
        return 0.0 if found.is_float else abs(found.scale)

    def bits(self, message: str, signal: str) -> int:
        """Length of a signal."""
        return self._messages[message].get_signal_by_name(signal).length
