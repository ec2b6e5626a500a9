"""A model's document with the hash of its own content, so that one that was changed afterwards is no model any more.

A parameter that has lost a digit is still a number, and no rule about numbers finds it.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

from models.data.errors import StructureError

SEAL = "sha256"


def sealed(document: dict[str, Any]) -> dict[str, Any]:
    """Return a document of plain types with the hash of everything else in it."""
    return document | {SEAL: content_sha256(document)}


def check_seal(document: dict[str, Any]) -> None:
    """Raise `StructureError` where a document carries a hash that is not its content's; older ones carry none."""
    if SEAL in document and document[SEAL] != content_sha256(document):
        raise StructureError(
            "model document was damaged or changed after it was written: its content has another sha256; "
            "export or fit it again"
        )


def content_sha256(document: dict[str, Any]) -> str:
    """Hash of a document without its seal, whatever the order of its keys and however a program writes a number."""
    content = {key: value for key, value in document.items() if key != SEAL}
    text = json.dumps(_canonical(content), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _canonical(value: Any) -> Any:
    """JavaScript writes 1.0 as 1 and -0.0 as 0: the same numbers are the same text here."""
    if isinstance(value, float):
        return int(value) if value.is_integer() else value
    if isinstance(value, dict):
        return {str(key): _canonical(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_canonical(part) for part in value]
    return value
