"""One family of test signals in each module, as `FAMILY`; a new module appears everywhere by itself."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from models.data.errors import ModelError
from models.design.test_signals.family import Family, FamilyRequest

__all__ = ["Family", "FamilyRequest", "family", "find_families"]


@cache
def find_families() -> dict[str, Family]:
    """All families by name, in alphabetical order."""
    found: list[Family] = []
    for module in pkgutil.iter_modules(__path__):
        candidate = getattr(importlib.import_module(f"{__name__}.{module.name}"), "FAMILY", None)
        if isinstance(candidate, Family):
            found.append(candidate)
    return {each.name: each for each in sorted(found, key=lambda each: each.name)}


def family(name: str) -> Family:
    """Return one family.

    Raises
    ------
    ModelError
        There is none of that name.
    """
    known = find_families()
    if name not in known:
        raise ModelError(f"signal {name!r} is unknown; use optimal or one of {', '.join(known)}")
    return known[name]
