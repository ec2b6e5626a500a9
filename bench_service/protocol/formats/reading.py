"""A protocol document of any known kind."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.formats.pybamm import from_pybamm
from bench_service.protocol.formats.unicycler import from_unicycler
from bench_service.protocol.steps import SCHEMA
from bench_service.strict_json import parse_strictly


def any_document(data: Any) -> dict[str, Any]:
    """Return a document of our own schema, made from one of aurora-unicycler where it is that.

    Raises
    ------
    ProtocolError
        It is neither.
    """
    if isinstance(data, Mapping) and "method" in data and "schema" not in data:
        return from_unicycler(data)
    if isinstance(data, Mapping):
        return dict(data)
    if isinstance(data, list):
        return from_pybamm(data)
    remedy = f"give an object with schema {SCHEMA!r}, one of aurora-unicycler, or PyBaMM strings"
    raise ProtocolError("no protocol", remedy=remedy)


def parse_document(text: str | bytes) -> dict[str, Any]:
    """Return the document in a file's text; raises `ProtocolError`."""
    try:
        return any_document(parse_strictly(text if isinstance(text, bytes) else text.encode()))
    except json.JSONDecodeError as error:
        raise ProtocolError(f"no JSON: {error.msg} at line {error.lineno}, column {error.colno}") from error
