"""What may have changed in a cell, alone and together, and by how much it may differ then."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from models.diagnosis.trend.settings import CHANGED, SETTINGS, USUAL, Sizes

Changes = tuple[str, ...]
CAPACITY, RESISTANCE, CURVE = "capacity", "resistance", "curve"
CHANGES = (CAPACITY, RESISTANCE, CURVE)
EVERY: tuple[Changes, ...] = tuple(each for n in range(len(CHANGES) + 1) for each in combinations(CHANGES, n))

# Ways in which resistances grow, by the sizes that are open then: at each state of charge by itself, by the same ohms
# everywhere, as a contact does, and all by the same factor.
_FORMS: dict[str, tuple[tuple[str, ...], ...]] = {
    RESISTANCE: (("resistance", "slower"), ("series",), ("overall",)),
}


@dataclass(frozen=True)
class Shape:
    """How a change may look.

    Attributes
    ----------
    form : sizes that are open, where there are several forms of it
    size : in units of the largest that is usual
    """

    form: tuple[str, ...]
    size: float


def sizes_of(changes: dict[str, Shape], capacity: float) -> Sizes:
    """What may differ where some of it has changed.

    Parameters
    ----------
    changes : form and size of each that is there
    capacity : how much of it is lost: by a part of that electrodes have slipped
    """
    own = USUAL
    if CAPACITY in changes:
        slip = float(np.hypot(USUAL.slip, SETTINGS.slip_of_capacity * capacity))
        own = replace(own, capacity=changes[CAPACITY].size * CHANGED.capacity, slip=slip)
    if RESISTANCE in changes:
        form, size = changes[RESISTANCE].form, changes[RESISTANCE].size
        own = replace(own, **{name: size * getattr(CHANGED, name) for name in form})
    if CURVE in changes:
        size = changes[CURVE].size
        slip = float(np.hypot(own.slip, size * CHANGED.slip))
        own = replace(
            own, curve_V=size * CHANGED.curve_V, slip=slip, shift=size * CHANGED.shift, loop_V=size * CHANGED.loop_V
        )
    return own


def every_size(changes: Changes) -> list[dict[str, Shape]]:
    """Forms and sizes that changes may have, as likely: a small one may stand beside a large one."""
    own = [[Shape(form, size) for form in _FORMS.get(each, ((),)) for size in SETTINGS.sizes] for each in changes]
    return [dict(zip(changes, each, strict=True)) for each in product(*own)]


def largest(changes: Changes) -> list[dict[str, Shape]]:
    """Every form of changes in its largest size."""
    own = [[Shape(form, max(SETTINGS.sizes)) for form in _FORMS.get(each, ((),))] for each in changes]
    return [dict(zip(changes, each, strict=True)) for each in product(*own)]


def cause_sizes(beside: Changes, change: float, matched_V: float) -> list[Sizes]:
    """What may differ beside a loss that is known with its curve, as likely.

    Parameters
    ----------
    beside : what else has changed
    change : of the capacity: half-cell curves are off by a part of it
    matched_V : what half-cell curves leave of that of the fresh cell
    """
    return _beside_cause(every_size(beside), change, matched_V)


def cause_largest(beside: Changes, change: float, matched_V: float) -> list[Sizes]:
    """The same in the largest size alone."""
    return _beside_cause(largest(beside), change, matched_V)


def _beside_cause(shapes: list[dict[str, Shape]], change: float, matched_V: float) -> list[Sizes]:
    out = []
    for each in shapes:
        own = sizes_of(each, change)
        slip = float(np.hypot(own.slip, SETTINGS.slip_of_loss * change))
        curve_V = float(np.sqrt(own.curve_V**2 + (SETTINGS.curve_of_loss_V * change) ** 2 + matched_V**2))
        out.append(replace(own, slip=slip, curve_V=curve_V))
    return out
