"""Electrodes of a cell whose materials nobody knows, by its own open-circuit curve.

What is sharp in the curve of a lithium cell against graphite are the stages of the negative electrode and its end,
where it is empty; the positive electrode falls smoothly, the faster the emptier it is (H. M. Dahn et al., J.
Electrochem. Soc. 159, 2012; Dubarry, Truchot and Liaw, J. Power Sources 219, 2012). So the slope of the cell's curve is
taken apart: the largest part of it that nowhere falls towards full is the positive electrode's, what is left of it the
negative's.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.electrode_match import USUAL_NEGATIVE
from models.effects.half_cells import USUAL_POSITIVE, HalfCells, half_cells
from models.effects.once_a_model import once_a_model
from models.effects.view import OwnModel

# Points of the cell's own curve, and its least slope there, V per SoC.
_POINTS, _FLATTEST_V = 161, 1e-3
# An empty negative electrode rises so fast, V per filling: beyond it there is no more of the cell.
_EMPTY_V = 20.0


@dataclass(frozen=True)
class OwnElectrodes(HalfCells):
    """Two electrodes of a cell's own curve.

    Attributes
    ----------
    negative_filling, negative_V : (k,) curve of the negative electrode, by rising filling
    """

    negative_filling: FloatArray = field(default_factory=lambda: np.zeros(0))
    negative_V: FloatArray = field(default_factory=lambda: np.zeros(0))

    def _negative_V(self, charge: FloatArray) -> FloatArray:
        filling = charge / self.negative_Ah
        beyond = np.minimum(filling - self.negative_filling[0], 0.0)
        return np.interp(filling, self.negative_filling, self.negative_V) - _EMPTY_V * beyond


@once_a_model
def own_electrodes(model: OwnModel) -> HalfCells | None:
    """Electrodes by the steps of a model's own curve; None where published ones are surely the cell's, or it has none.

    Parameters
    ----------
    model : with its open-circuit curve
    """
    published = half_cells(model)
    return None if published is None or published.sure else _apart(model, published)


def _apart(model: OwnModel, published: HalfCells) -> HalfCells:
    soc, slope_V = _slope(model)
    smooth_V = np.minimum.accumulate(slope_V[::-1])[::-1]
    positive_V, steps_V = _summed(soc, smooth_V), _summed(soc, slope_V - smooth_V)
    middle = 0.5 * (soc[0] + soc[-1])
    both_V = float(np.interp(middle, soc, positive_V + steps_V))
    level_V = float(model.open_circuit_V(np.array([middle]))[0]) - both_V
    (x0, x1), (y0, y1) = USUAL_NEGATIVE, USUAL_POSITIVE
    negative_Ah, positive_Ah = 1.0 / (x1 - x0), 1.0 / (y0 - y1)
    cell = OwnElectrodes(
        negative=published.negative,
        negative_Ah=negative_Ah,
        positive_Ah=positive_Ah,
        lithium_Ah=x0 * negative_Ah + y0 * positive_Ah,
        filling=(y0 + soc * (y1 - y0))[::-1],
        potential_V=(level_V + positive_V + steps_V[-1])[::-1],
        limits_V=(0.0, 1.0),
        left_V=published.left_V,
        covered=published.covered,
        chance=0.0,
        negative_filling=x0 + soc * (x1 - x0),
        negative_V=steps_V[-1] - steps_V,
    )
    ends = cell.voltage_V(np.array([x0, x1]) * negative_Ah)
    return replace(cell, limits_V=(float(ends[0]), float(ends[1])))


def _slope(model: OwnModel) -> tuple[FloatArray, FloatArray]:
    """(k,) states of charge from empty to full, and slope of the curve there, V; beyond what is known it goes on."""
    low, high = model.soc_range
    known = np.linspace(max(low, 0.0), min(high, 1.0), _POINTS)
    curve_V = np.maximum.accumulate(model.open_circuit_V(known))
    slope_V = np.maximum(np.gradient(curve_V, known), _FLATTEST_V)
    soc = np.linspace(0.0, 1.0, _POINTS)
    soc = np.unique(np.concatenate([soc[(soc < known[0]) | (soc > known[-1])], known]))
    return soc, np.interp(soc, known, slope_V)


def _summed(soc: FloatArray, slope_V: FloatArray) -> FloatArray:
    """(k,) integral from the first of (k,) states of charge on."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (slope_V[1:] + slope_V[:-1]) * np.diff(soc))])
