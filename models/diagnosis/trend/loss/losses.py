"""Losses that a cell may have: of lithium, or of material of either electrode, each with a curve of its own.

Each makes one capacity and one open-circuit curve of every share that is lost (Dubarry, Truchot and Liaw, J. Power
Sources 219, 2012).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from models.effects.bent_curve import BentCurve
from models.effects.half_cells import Curve, HalfCells, likely

LITHIUM, NEGATIVE, POSITIVE = "lithium", "negative", "positive"
SHARES = np.linspace(0.01, 0.36, 36)


@dataclass(frozen=True)
class Way:
    """A way to lose something.

    Attributes
    ----------
    cause : what is lost
    weight : probability of it beside other ways
    without : fresh electrodes, share -> electrodes
    """

    cause: str
    weight: float
    without: Callable[[HalfCells, float], HalfCells]


CAUSES = (LITHIUM, NEGATIVE, POSITIVE)
# Lithium is what most cells lose first (Birkl et al., J. Power Sources 341, 2017). With material goes the lithium that
# is in it, as much as when the cell is half full: material that is lost full or empty of it is that and lost lithium.
WAYS = (
    Way(LITHIUM, 0.4, HalfCells.less_lithium),
    Way(NEGATIVE, 0.3, HalfCells.less_negative),
    Way(POSITIVE, 0.3, HalfCells.less_positive),
)


@dataclass(frozen=True)
class Loss:
    """A cell that has lost something.

    Attributes
    ----------
    way : number of it among `WAYS`
    share : that is lost
    change : of the capacity, relative
    bent : by how much its curve differs from the fresh one
    chance : how likely its electrodes are those of the cell
    """

    way: int
    share: float
    change: float
    bent: BentCurve
    chance: float


@lru_cache(maxsize=4)
def losses_of(curve: Curve) -> tuple[Loss, ...]:
    """All losses that are tried of a cell, by each pair of electrodes that it may have."""
    out = list[Loss]()
    for fresh in likely(curve):
        for number, way in enumerate(WAYS):
            for share in SHARES.tolist():
                aged = way.without(fresh, share)
                change = aged.capacity / fresh.capacity - 1.0
                out.append(Loss(number, share, change, BentCurve(fresh, aged), fresh.chance))
    return tuple(out)
