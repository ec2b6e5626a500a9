"""Reads one JSON object of a protocol: each key once, of the right kind, and none that is not known."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from bench_service.errors import Where
from bench_service.protocol.errors import ProtocolError

_RATE = re.compile(r"^\s*(?P<times>[0-9.]*)\s*(?P<sign>[CD])\s*(?:/\s*(?P<parts>[0-9.]+))?\s*$")
_LARGEST, _NEARLY_MOST = 1e9, 1e308


class Fields:
    """The keys of one object; `done` refuses those that nobody has asked for.

    Parameters
    ----------
    data : object
        From JSON.
    where : sequence of str or int
        Path to it in the document, for messages.
    """

    def __init__(self, data: Any, where: Where = ()) -> None:
        if not isinstance(data, Mapping):
            raise ProtocolError(f"an object is needed, not {_kind(data)}", where)
        self._left = dict(data)
        self.where = where

    def __contains__(self, name: str) -> bool:
        """Whether a key is there and not null."""
        return self._left.get(name) is not None

    def at(self, *names: str | int) -> Where:
        """Return the path to a key."""
        return (*self.where, *names)

    def take(self, name: str) -> Any:
        """Return a key's value, None where it is not there."""
        return self._left.pop(name, None)

    def text(self, name: str) -> str | None:
        """Return a printable text."""
        value = self.take(name)
        if value is not None and not (isinstance(value, str) and value.strip() and len(value) <= 2000):
            raise ProtocolError("a text is needed", self.at(name), value=value)
        return value

    def flag(self, name: str) -> bool | None:
        """Return true, false or nothing."""
        value = self.take(name)
        if value is not None and not isinstance(value, bool):
            raise ProtocolError("true or false is needed", self.at(name), value=value)
        return value

    def number(self, name: str, low: float = -_LARGEST, high: float = _LARGEST) -> float | None:
        """Return a finite number within ``low`` and ``high``."""
        value = self.take(name)
        return None if value is None else number(value, self.at(name), low, high)

    def positive(self, name: str) -> float | None:
        """Return a number above 0."""
        value = self.number(name)
        if value is not None and not value > 0:
            raise ProtocolError("must be above 0", self.at(name), value=value)
        return value

    def count(self, name: str) -> int | None:
        """Return a whole number of at least 1."""
        value = self.number(name, 1)
        if value is not None and value != int(value):
            raise ProtocolError("a whole number is needed", self.at(name), value=value)
        return None if value is None else int(value)

    def rate(self, name: str) -> float | None:
        """Return a C-rate: a number, or a text such as ``C/3`` and ``D/2``."""
        value = self.take(name)
        if isinstance(value, str):
            return _rate(value, self.at(name))
        return None if value is None else number(value, self.at(name))

    def window(self, name: str) -> tuple[float, float] | None:
        """Return ``[low, high]``; null leaves an end open."""
        value = self.take(name)
        if value is None:
            return None
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise ProtocolError("two numbers [low, high] are needed", self.at(name), value=value)
        low, high = (_open(each, end, self.at(name)) for each, end in zip(value, (-math.inf, math.inf), strict=True))
        if not low < high:
            raise ProtocolError("low must be below high", self.at(name), value=value)
        return low, high

    def numbers(self, name: str) -> tuple[float, ...] | None:
        """Return an array of numbers."""
        value = self.take(name)
        if value is None:
            return None
        if not isinstance(value, list | tuple):
            raise ProtocolError("an array of numbers is needed", self.at(name))
        return tuple(number(each, self.at(name, k)) for k, each in enumerate(value))

    def done(self) -> None:
        """Refuse what is left.

        Raises
        ------
        ProtocolError
            A key is not known here.
        """
        unknown = sorted(name for name, value in self._left.items() if value is not None)
        if unknown:
            raise ProtocolError("unknown key", self.at(unknown[0]), remedy="remove it, or see docs/protocols.md")


def number(value: Any, where: Where, low: float = -_LARGEST, high: float = _LARGEST) -> float:
    """Return a finite number within limits; raises `ProtocolError`."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ProtocolError(f"a number is needed, not {_kind(value)}", where)
    if not low <= value <= high or math.isinf(value):  # compared first: an integer may be larger than any double
        shown = value if isinstance(value, float) else float(max(-_NEARLY_MOST, min(_NEARLY_MOST, value)))
        raise ProtocolError("outside what is allowed", where, value=shown, limit=(low, high))
    return float(value)


def _open(value: Any, end: float, where: Where) -> float:
    return end if value is None else number(value, where)


def _rate(text: str, where: Where) -> float:
    found = _RATE.match(text)
    if found is None:
        raise ProtocolError("no C-rate", where, value=text, remedy='write a number, or "C/3", "2C", "D/2"')
    times, parts = float(found["times"] or 1.0), float(found["parts"] or 1.0)
    if not parts > 0:
        raise ProtocolError("no C-rate", where, value=text)
    return (-1.0 if found["sign"] == "D" else 1.0) * times / parts


def _kind(value: Any) -> str:
    names = {type(None): "null", bool: "true or false", str: "a text", list: "an array", dict: "an object"}
    return names.get(type(value), type(value).__name__)
