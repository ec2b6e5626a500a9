"""Where curves over the state of charge have their knots, and the hats that stand on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.errors import NotIdentifiableError
from models.data.timeseries import FloatArray
from models.network.signals.filters import FURTHEST_BEHIND

# Knots crowd towards empty and full, where curves of all chemistries bend most.
_CROWDING = 0.05
_RIM = 0.02
# Distance of the outermost knots, which only continue what the last trained ones say: as far as a mean can be behind a
# surface, or that would take back more than the curve has beyond them.
_BEYOND = FURTHEST_BEHIND
# A range of the state of charge that is smaller is rounding.
_LEAST_RANGE = 1e-5


@dataclass(frozen=True)
class Knots:
    """Knots of the open-circuit curve; those of gains are some of them.

    Attributes
    ----------
    soc : (n,) rising, over the trained range
    gain : (g,) places among them at which gains have theirs
    slope : (e,) the same of the curve's slope with temperature
    """

    soc: FloatArray
    gain: np.ndarray
    slope: np.ndarray

    @property
    def outer(self) -> FloatArray:
        """(n + 2,) with one more on each side, far out."""
        return np.concatenate([[self.soc[0] - _BEYOND], self.soc, [self.soc[-1] + _BEYOND]])


def make_knots(low: float, high: float, n_curve: int, n_gain: int, n_slope: int) -> Knots:
    """Knots over a range of the state of charge.

    Parameters
    ----------
    low, high : trained range
    n_curve, n_gain, n_slope : how many over the whole range 0..1; a smaller one gets fewer, but at least 4, 2 and 2

    Raises
    ------
    NotIdentifiableError
        The state of charge does not move.
    """
    if not high - low >= _LEAST_RANGE:
        raise NotIdentifiableError(
            f"the state of charge hardly moves ({low:.4f} to {high:.4f}): a curve needs runs that charge or discharge"
        )
    first, last = min(0.0, low), max(1.0, high)
    fine = np.linspace(low, high, 4001)
    share = (fine - first) / (last - first)
    crowded = share + _CROWDING * np.log((share + _RIM) / (1.0 + _RIM - share))
    whole = 1.0 + 2.0 * _CROWDING * np.log((1.0 + _RIM) / _RIM)
    part = float(crowded[-1] - crowded[0]) / whole
    count = max(4, round(part * (n_curve - 1)) + 1)
    soc = np.interp(np.linspace(crowded[0], crowded[-1], count), crowded, fine)

    def places(n: int) -> np.ndarray:
        return np.unique(np.round(np.linspace(0, count - 1, max(2, round(part * (n - 1)) + 1))).astype(np.int64))

    return Knots(soc, places(n_gain), places(n_slope))


def hats(knots: FloatArray, at: FloatArray) -> FloatArray:
    """(m, n) hat functions on rising knots, constant beyond the last ones; each row sums to 1."""
    if len(knots) == 1:
        return np.ones((len(at), 1))
    out = np.zeros((len(at), len(knots)))
    left = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((at - knots[left]) / (knots[left + 1] - knots[left]), 0.0, 1.0)
    rows = np.arange(len(at))
    out[rows, left] = 1.0 - share
    out[rows, left + 1] = share
    return out
