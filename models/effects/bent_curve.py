"""By how much the voltage of a cell that has lost something differs from the fresh one's, under current.

Each electrode's potential is that of its particles' surfaces, which are ahead of what they are filled with in the mean,
and not all alike: across an electrode some are further than others. So the steps of a potential come later in a
discharge than in a charge, and are not as sharp as those of a half-cell that was measured slowly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import gaussian_filter1d

from models.data.timeseries import FloatArray
from models.effects.half_cells import HalfCells
from models.effects.view import View

# States of charge at which curves are drawn.
_DRAWN = np.linspace(-0.1, 1.1, 601)
# Over so much of the state of charge, as a standard deviation, the particles of an electrode differ under a usual
# current. With sharp steps the right loss of half of the simulated cells was less likely than none; 0.02 to 0.04 serve
# alike.
_UNLIKE_SOC = 0.03
# Nearer to empty and full than this many of these they are less unlike: a potential that is steep holds them together.
_TOGETHER = 3.0
# Time constant, s, of the current that surfaces are ahead by: of 120 simulated cells 600 s named 97, 300 s 99.
_SLOW_S = 300.0


@dataclass(frozen=True)
class BentCurve:
    """The difference of two cells' curves; the surfaces of the aged one are as far ahead as the fresh one's.

    Attributes
    ----------
    fresh, aged : electrodes before and after
    """

    fresh: HalfCells
    aged: HalfCells

    @cached_property
    def _drawn_V(self) -> tuple[FloatArray, FloatArray]:
        before, after = self.fresh.electrodes_V(_DRAWN), self.aged.electrodes_V(_DRAWN)
        return _unlike(after[0] - before[0]), _unlike(after[1] - before[1])

    def voltage_V(self, soc: FloatArray, rate: FloatArray) -> FloatArray:
        """(n,) by how much the aged cell's voltage is higher at the same state of charge of its own.

        Parameters
        ----------
        soc : (n,) fraction 0..1
        rate : (n,) current over the fresh capacity, 1/h, as `slow_rate` has it
        """
        ahead, (negative_V, positive_V) = self.fresh.ahead, self._drawn_V
        raised_V = np.interp(soc + ahead.of_positive(soc, rate), _DRAWN, positive_V)
        return raised_V - np.interp(soc + ahead.of_negative(soc, rate), _DRAWN, negative_V)


def slow_rate(view: View) -> FloatArray:
    """(m,) the current over the capacity that surfaces are ahead by, 1/h."""
    return view.low_pass(view.run.current_A, _SLOW_S) / view.capacity_Ah


def _unlike(curve_V: FloatArray) -> FloatArray:
    """A curve as particles show it that are not all filled alike."""
    smooth = gaussian_filter1d(curve_V, _UNLIKE_SOC / (_DRAWN[1] - _DRAWN[0]), mode="nearest")
    inside = np.clip(np.minimum(_DRAWN, 1.0 - _DRAWN) / (_TOGETHER * _UNLIKE_SOC), 0.0, 1.0)
    return inside * smooth + (1.0 - inside) * curve_V
