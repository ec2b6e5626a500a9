"""One TOML table, read key by key: wrong types, missing keys and unknown keys are told by file, key and reason."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar, cast, overload

from drivers.errors import BadMapError
from drivers.expression import Expression, ExpressionError, parse_expression

T = TypeVar("T")
Word = TypeVar("Word", bound=str)
_MISSING: object = object()  # a default that there is not
_NAMES: Mapping[type, str] = {
    str: "a string",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    list: "a list",
    dict: "a table",
}


class Table:
    """A table of a device map, at the dotted path `key`.

    Each key is taken once, with the type that the reader needs; without a default it must be there.
    """

    def __init__(self, file: Path, key: str, content: object) -> None:
        self.file, self.key = file, key
        if not isinstance(content, Mapping):
            self.fail("", f"must be a table, not {content!r}")
        self._left: dict[str, object] = dict(cast(Mapping[str, object], content))

    def fail(self, key: str, reason: str) -> NoReturn:
        """Raise `BadMapError` for a key of this table, or for the table itself where `key` is empty."""
        raise BadMapError(self.file, ".".join(part for part in (self.key, key) if part) or "(file)", reason)

    @overload
    def take(self, key: str, kind: type[T]) -> T: ...
    @overload
    def take(self, key: str, kind: type[T], default: T) -> T: ...
    def take(self, key: str, kind: type[Any], default: object = _MISSING) -> Any:
        """Take one key out of the table, of one type; whole numbers pass as numbers, booleans never do."""
        return self._taken(key, kind, default)

    def _taken(self, key: str, kind: type, default: object) -> object:
        value = self._left.pop(key, _MISSING)
        if value is _MISSING:
            if default is _MISSING:
                self.fail(key, f"is missing; needs {_NAMES[kind]}")
            return default
        if kind is float and type(value) is int:
            value = float(value)
        if type(value) is not kind or (isinstance(value, float) and not math.isfinite(value)):
            self.fail(key, f"must be {_NAMES[kind]}, not {value!r}")
        return value

    @overload
    def choose(self, key: str, allowed: Collection[Word]) -> Word: ...
    @overload
    def choose(self, key: str, allowed: Collection[Word], default: Word) -> Word: ...
    @overload
    def choose(self, key: str, allowed: Collection[Word], default: None) -> Word | None: ...
    def choose(self, key: str, allowed: Collection[str], default: object = _MISSING) -> object:
        """Take a string that must be one of a few."""
        value = self._taken(key, str, default)
        if value is not None and value not in allowed:
            self.fail(key, f"must be one of {', '.join(sorted(allowed))}, not {value!r}")
        return value

    @overload
    def integer(self, key: str, low: int, high: int) -> int: ...
    @overload
    def integer(self, key: str, low: int, high: int, default: int) -> int: ...
    @overload
    def integer(self, key: str, low: int, high: int, default: None) -> int | None: ...
    def integer(self, key: str, low: int, high: int, default: object = _MISSING) -> object:
        """Take a whole number within limits."""
        value = self._taken(key, int, default)
        if isinstance(value, int) and not low <= value <= high:
            self.fail(key, f"must be within {low} and {high}, not {value}")
        return value

    def integers(self, key: str, low: int, high: int, default: Collection[int] | None = None) -> tuple[int, ...]:
        """Take a list of whole numbers within limits."""
        values = self.take(key, list) if default is None else self.take(key, list, [*default])
        if any(type(value) is not int or not low <= value <= high for value in values):
            self.fail(key, f"must be a list of whole numbers within {low} and {high}, not {values!r}")
        return tuple(values)

    def names(self, key: str) -> tuple[str, ...]:
        """Take an optional list of names."""
        names = self.take(key, list, [])
        if not all(isinstance(name, str) for name in names):
            self.fail(key, f"must be a list of names, not {names!r}")
        return tuple(names)

    def not_negative(self, key: str, default: float) -> float:
        """Take an optional number that is not below zero."""
        value = self.take(key, float, default)
        if value < 0:
            self.fail(key, f"must not be negative, not {value}")
        return value

    def hexadecimal(self, key: str) -> bytes:
        """Take bytes written in hexadecimal."""
        text = self.take(key, str)
        try:
            return bytes.fromhex(text)
        except ValueError:
            self.fail(key, f"must be bytes in hexadecimal, not {text!r}")

    # --- expressions ---------------------------------------------------------------------------------------
    def expression(self, key: str, names: Collection[str]) -> Expression | None:
        """Take an optional expression; a plain number is one too."""
        value = self._left.pop(key, None)
        return None if value is None else self._expression(key, value, names)

    def needed_expression(self, key: str, names: Collection[str]) -> Expression:
        """Take an expression that must be there."""
        return self._expression(key, self.any_value(key), names)

    def interval(self, key: str, names: Collection[str]) -> tuple[Expression, Expression] | None:
        """Take an optional pair of expressions, low and high."""
        value = self._left.pop(key, None)
        if value is None:
            return None
        if not isinstance(value, list) or len(value) != 2:
            self.fail(key, f"must be a list of two expressions, low and high, not {value!r}")
        low, high = (self._expression(f"{key}[{i}]", part, names) for i, part in enumerate(value))
        return low, high

    def intervals(self, keys: Collection[str], names: Collection[str]) -> Mapping[str, tuple[Expression, Expression]]:
        """Take those pairs of expressions that are there."""
        found = {key: self.interval(key, names) for key in keys}
        return MappingProxyType({key: value for key, value in found.items() if value is not None})

    def _expression(self, key: str, value: object, names: Collection[str]) -> Expression:
        if type(value) in (int, float):
            value = repr(value)
        if not isinstance(value, str):
            self.fail(key, f"must be an expression in quotes, not {value!r}")
        try:
            expression = parse_expression(value)
            if not expression.names:
                expression.evaluate({})
        except ExpressionError as error:
            self.fail(key, str(error))
        unknown = sorted(expression.names - set(names))
        if unknown:
            self.fail(key, f"'{value}' uses {', '.join(unknown)}, which [const] does not define")
        return expression

    # --- tables inside -------------------------------------------------------------------------------------
    def table(self, key: str) -> Table:
        """Take a table inside this one; an absent one is empty."""
        return Table(self.file, f"{self.key}.{key}" if self.key else key, self._left.pop(key, {}))

    def tables(self, key: str) -> list[Table]:
        """Take an array of tables; an absent one is empty."""
        path = f"{self.key}.{key}" if self.key else key
        return [Table(self.file, f"{path}[{i}]", part) for i, part in enumerate(self.take(key, list, []))]

    def named(self, build: Callable[[str, Table], T]) -> Mapping[str, T]:
        """Take every key that is left as a table, and build one value from each."""
        result: dict[str, T] = {}
        for name, child in {key: self.table(key) for key in self.keys()}.items():
            result[name] = build(name, child)
            child.finish()
        return MappingProxyType(result)

    def keys(self) -> tuple[str, ...]:
        """Return the keys that are left."""
        return tuple(self._left)

    # --- anything ------------------------------------------------------------------------------------------
    def values(self) -> dict[str, object]:
        """Take every key that is left, as it stands."""
        left, self._left = self._left, {}
        return left

    def any_value(self, key: str) -> object:
        """Take one key that must be there, of any type."""
        if key not in self._left:
            self.fail(key, "is missing")
        return self._left.pop(key)

    def finish(self) -> None:
        """Refuse what nobody asked for: a misspelt key must not pass as an absent one."""
        for key in self._left:
            self.fail(key, "is not a known key here")
