"""What is worked out of a model once, however often it is asked for."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import wraps
from typing import TypeVar

from models.effects.view import OwnModel

T = TypeVar("T")


def once_a_model(make: Callable[[OwnModel], T]) -> Callable[[OwnModel], T]:
    """Let a function keep what it made of a model as long as that lives; by its place in memory, for none has a hash.

    Parameters
    ----------
    make : model -> what is kept
    """
    made: dict[int, tuple[weakref.ref[OwnModel], T]] = {}

    @wraps(make)
    def kept(model: OwnModel) -> T:
        place = id(model)
        known = made.get(place)
        if known is None or known[0]() is not model:
            known = weakref.ref(model, lambda _: made.pop(place, None)), make(model)
            made[place] = known
        return known[1]

    return kept
