"""Physical effects that a model may lack or a cell may show anew: one module each, found by listing this package."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import replace
from functools import cache

from models.data.errors import ModelError
from models.effects.effect import Effect, Parameter

__all__ = ["Effect", "Parameter", "effect", "effects"]


@cache
def effects() -> dict[str, Effect]:
    """All effects by name, in alphabetical order."""
    found: list[Effect] = []
    for module in pkgutil.iter_modules(__path__):
        candidate = getattr(importlib.import_module(f"{__name__}.{module.name}"), "EFFECT", None)
        if isinstance(candidate, Effect):
            found.append(candidate)
    return {each.name: _related(each, found) for each in sorted(found, key=lambda each: each.name)}


def _related(one: Effect, every: list[Effect]) -> Effect:
    """The effect with what others say of it, so that a new one need not be written into the files of the old ones."""
    parts = tuple(each.name for each in every if one.name in each.part_of and each.name not in one.contains)
    twin = one.twin or next((each.name for each in every if each.twin == one.name), None)
    return replace(one, contains=(*one.contains, *parts), twin=twin) if parts or twin != one.twin else one


def effect(name: str) -> Effect:
    """Return an effect by name.

    Raises
    ------
    ModelError
        There is none of this name; the message lists the names.
    """
    try:
        return effects()[name]
    except KeyError:
        raise ModelError(f"effect {name!r} is unknown; known are {', '.join(effects())}") from None
