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
# Nearer to empty a curve is as it is here: where a cell is empty under load is not where it is at rest, and all is
# steep. Of 41 simulated cells 27 were told within a fifth with 0.1, 26 with 0.06 and 25 with 0.15.
_EMPTY_SOC = 0.1
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
    def _drawn_V(self) -> tuple[FloatArray, ...]:
        """Potentials of the negative and the positive electrode, before and after."""
        return tuple(_unlike(each) for one in (self.fresh, self.aged) for each in one.electrodes_V(_DRAWN))

    def voltage_V(self, soc: FloatArray, rate: FloatArray, change: float) -> FloatArray:
        """(n,) by how much the aged cell's voltage is higher than the fresh one's, each as full as the other when full.

        Parameters
        ----------
        soc : (n,) fraction 0..1 of the capacity that the aged cell has under load
        rate : (n,) current over the fresh capacity, 1/h, as `slow_rate` has it
        change : of that capacity against the fresh one, relative; it ends where the voltage under load does, and need
            not be that at rest
        """
        soc = np.maximum(soc, _EMPTY_SOC)
        smaller = self.fresh.capacity / self.aged.capacity
        own_soc = 1.0 - (1.0 - soc) * (1.0 + change) * smaller
        negative_V, positive_V, aged_negative_V, aged_positive_V = self._drawn_V
        # Surfaces are ahead by as much charge as before, which is more of what is left.
        aged_V = self._at(own_soc, rate * smaller, aged_negative_V, aged_positive_V)
        return aged_V - self._at(soc, rate, negative_V, positive_V)

    def _at(self, soc: FloatArray, rate: FloatArray, negative_V: FloatArray, positive_V: FloatArray) -> FloatArray:
        """(n,) cell's voltage of two drawn potentials, with the surfaces ahead."""
        ahead = self.fresh.ahead
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
