"""JSON that follows RFC 8259 to the letter."""

from __future__ import annotations

import json
import re
from typing import Any, NoReturn

_LONG, _SURROGATE = re.compile(r"[0-9]{309}"), re.compile(r"\\u[dD][89a-fA-F]")
_NUL = re.compile(r"(?<!\\)(?:\\\\)*\\u0000")


def parse_strictly(body: bytes) -> Any:
    """Parse a document.

    Raises
    ------
    json.JSONDecodeError
        Not JSON; NaN or Infinity as a token; a key that appears twice; nested too deeply; an integer that no double
        holds; half of a pair of surrogates, which no UTF-8 can say; NUL in a text, which no database keeps.
    """
    try:
        text = body.decode(json.detect_encoding(body))
        # A function of our own for each integer takes time: only where one is that long.
        integer = _integer if _LONG.search(text) else None
        found = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_unique, parse_int=integer)
        if _SURROGATE.search(text):
            json.dumps(found, ensure_ascii=False).encode()
        if _NUL.search(text):
            raise ValueError("a text holds NUL (\\u0000); leave it out")
        return found
    except json.JSONDecodeError:
        raise
    except RecursionError as error:
        raise json.JSONDecodeError("nested too deeply", "", 0) from error
    except UnicodeEncodeError as error:
        raise json.JSONDecodeError("a text holds half of a pair of surrogates, which is no character", "", 0) from error
    except ValueError as error:  # no UTF-8, a number of thousands of digits, or one of the hooks
        raise json.JSONDecodeError(str(error)[:200], "", 0) from error


def _refuse_constant(token: str) -> NoReturn:
    raise ValueError(f"{token} is not a JSON number; every number must be finite")


def _integer(digits: str) -> int:
    try:
        float(found := int(digits))
    except OverflowError as error:
        raise ValueError(f"{digits[:20]}... is larger than any number that is worked with; at most 1.8e308") from error
    return found


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"key {twice[:100]!r} appears twice")
    return found
