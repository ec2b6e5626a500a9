"""Which part of a bounded network stands for which effect: effects are left out of it and given back by name."""

from __future__ import annotations

from collections.abc import Iterable

from models.data.errors import ModelError
from models.effects import effects


def bounded_effects() -> tuple[str, ...]:
    """Effects that a bounded network can have, and can do without."""
    return tuple(name for name, each in effects().items() if each.bounded_part)


def parts_of(names: Iterable[str]) -> tuple[str, ...]:
    """Parts of a bounded network that stand for some effects.

    Raises
    ------
    ModelError
        An effect has none.
    """
    known, wanted = effects(), list(names)
    unknown = [name for name in wanted if name not in known or not known[name].bounded_part]
    if unknown:
        raise ModelError(
            f"effect {', '.join(unknown)} cannot be left out of a bounded network; "
            f"it can do without {', '.join(bounded_effects())}"
        )
    return tuple(known[name].bounded_part or "" for name in wanted)


def resolved_parts(names: Iterable[str]) -> tuple[str, ...]:
    """Parts of a bounded network that stand for some effects, those that are always in one as well.

    Raises
    ------
    ModelError
        A bounded network cannot have an effect.
    """
    known = effects()
    parts = {name: known[name].bounded_part for name in names}
    lacking = [name for name, part in parts.items() if part is None]
    if lacking:
        raise ModelError(f"a bounded network cannot have {', '.join(lacking)}")
    return tuple(part for part in parts.values() if part is not None)


def effects_of(parts: Iterable[str]) -> tuple[str, ...]:
    """Effects that some parts stand for."""
    wanted = set(parts)
    return tuple(name for name, each in effects().items() if each.bounded_part in wanted)
