"""Parsing of arguments: one line for what is wrong, and the kinds of values that several commands take."""

from __future__ import annotations

import math
import sys
from argparse import ArgumentParser, ArgumentTypeError
from typing import NoReturn


class OneLineParser(ArgumentParser):
    """An argument parser that says what is wrong in one line instead of printing its usage first."""

    def error(self, message: str) -> NoReturn:
        """Print one line on standard error and end with status 2."""
        line = " ".join(message.split())
        sys.stderr.write(f"error: {line} (see '{self.prog} --help')\n")
        sys.exit(2)


def number(text: str) -> float:
    """Return a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def positive(text: str) -> float:
    """Return a number above zero."""
    value = number(text)
    if value <= 0:
        raise ArgumentTypeError(f"{text} must be above 0")
    return value


def fraction(text: str) -> float:
    """Return a number from 0 to 1."""
    value = number(text)
    if not 0.0 <= value <= 1.0:
        raise ArgumentTypeError(f"{text} must lie between 0 and 1 (a fraction, not percent)")
    return value


def efficiency(text: str) -> float:
    """Return a number above 0 and up to 1."""
    value = fraction(text)
    if value == 0.0:
        raise ArgumentTypeError(f"{text} must be above 0 and up to 1, such as 0.999")
    return value


def fractions(text: str) -> tuple[float, ...]:
    """Return one or more fractions separated by commas."""
    return tuple(fraction(part) for part in text.split(","))


def numbers(text: str) -> tuple[float, ...]:
    """Return one or more finite numbers separated by commas."""
    return tuple(number(part) for part in text.split(","))


def names(text: str) -> tuple[str, ...]:
    """Return one or more names separated by commas."""
    found = tuple(part.strip() for part in text.split(","))
    if not all(found):
        raise ArgumentTypeError(f"{text!r} has an empty name; separate names by single commas")
    return found


def natural(text: str) -> int:
    """Return a whole number from 0 on."""
    if not text.isascii() or not text.isdecimal():
        raise ArgumentTypeError(f"{text!r} is not a whole number from 0 on")
    return int(text)


def port(text: str) -> int:
    """Return a TCP port; 0 stands for any free one."""
    value = natural(text)
    if value > 65535:
        raise ArgumentTypeError(f"{text} is not a TCP port (0 to 65535; 0 takes a free one)")
    return value


def named_numbers(text: str) -> dict[str, float]:
    """Return ``{"a": 1.0, "b": 2.0}`` for ``a=1,b=2``."""
    values: dict[str, float] = {}
    for part in filter(None, (each.strip() for each in text.split(","))):
        name, equals, value = part.partition("=")
        if not equals or not name.strip():
            raise ArgumentTypeError(f"{part!r} does not read name=value")
        if name.strip() in values:
            raise ArgumentTypeError(f"{name.strip()!r} is given twice")
        values[name.strip()] = number(value.strip())
    return values
