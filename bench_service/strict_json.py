"""JSON that follows RFC 8259 to the letter."""

from __future__ import annotations

import json
from typing import Any, NoReturn


def parse_strictly(body: bytes) -> Any:
    """Parse a document.

    Raises
    ------
    json.JSONDecodeError
        Not JSON; NaN or Infinity as a token; a key that appears twice; nested too deeply.
    """
    try:
        return json.loads(body, parse_constant=_refuse_constant, object_pairs_hook=_unique)
    except json.JSONDecodeError:
        raise
    except RecursionError as error:
        raise json.JSONDecodeError("nested too deeply", "", 0) from error
    except ValueError as error:  # no UTF-8, a number of thousands of digits, or one of the hooks
        raise json.JSONDecodeError(str(error)[:200], "", 0) from error


def _refuse_constant(token: str) -> NoReturn:
    raise ValueError(f"{token} is not a JSON number; every number must be finite")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"key {twice[:100]!r} appears twice")
    return found
