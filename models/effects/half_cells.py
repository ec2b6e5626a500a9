"""A full cell's open-circuit curve taken apart into its two electrodes, which may slip against each other or shrink.

With the charge q in the negative electrode, all in units of the fresh cell's capacity, the cell's voltage at rest is
U(q) = U_p((N - q) / C_p) - U_n(q / C_n): C_n and C_p are the electrodes' capacities, N the lithium that both hold. The
cell is empty and full where U meets the voltages that it had there when fresh (Dubarry, Truchot and Liaw, J. Power
Sources 219, 2012; Birkl et al., J. Power Sources 341, 2017).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.half_cell_curves import NEGATIVES, POSITIVES
from models.effects.view import OwnModel

# Points of the full cell's curve that the electrodes are matched to, and of the charge on which it is drawn.
_MATCHED, _DRAWN, _TABLE = 40, 2401, 600
# Evaluations of a match.
_STEPS = 30
# Charge beyond empty and full that is drawn.
_BEYOND = 0.35
# How sharp a voltage and a state of charge of that curve are.
_SHARP_V, _SHARP_SOC = 0.005, 0.005
# Nearer to empty and full the current makes most of the curve.
_INNER = (0.06, 0.96)
# By how much all of it, its slope and its bend may be off, V: runs at one current tell the curve from what the current
# makes of it by its steps alone.
_OFF_V, _MOST_OFF_V = np.array([0.03, 0.015, 0.015]), 0.2
# A match that leaves more than this in the root mean square, V, is none: electrodes of other materials.
_GOOD_V = 0.015
# One that leaves less than this over so much of the state of charge, where no other pair does nearly as well, with
# electrodes of not more than these capacities over the cell's, is hardly by chance.
_SURE_V, _NEXT, _SURE_SOC, _LARGEST_N, _LARGEST_P = 0.004, 1.3, 0.8, 1.9, 2.6
# Fillings of graphite and of its counterpart in a usual cell, empty and full (Birkl et al. 2017).
_USUAL_N, _USUAL_P = (0.03, 0.85), (0.93, 0.35)
# By how much a window of filling is usually another one, where a flat curve does not tell.
_UNUSUAL = 0.2
# Least part of its filling that a positive electrode goes through from full to empty.
_LEAST_P = 0.25
# No positive electrode is flatter than this beyond where its curve is known, V per filling.
_STEEP_V = 1.0
# Lithium cells against graphite rest above this when half full; no other cell's curve is taken apart.
_LEAST_V = 2.8

Curve = tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class HalfCells:
    """Two electrodes.

    Attributes
    ----------
    negative : name of its published curve
    negative_Ah, positive_Ah, lithium_Ah : capacity of either electrode and the lithium in both, over the cell's fresh
        capacity
    filling, potential_V : (k,) curve of the positive electrode, by falling potential
    limits_V : of the cell at rest, empty and full
    left_V, close_V : root mean square of what published curves leave of the cell's own; the same beside what that may
        be off by as a whole, in its slope and in its bend
    next_V : `close_V` of the next best pair of published curves
    covered : states of charge that the cell's own curve is known over
    """

    negative: str
    negative_Ah: float
    positive_Ah: float
    lithium_Ah: float
    filling: FloatArray
    potential_V: FloatArray
    limits_V: tuple[float, float]
    left_V: float
    close_V: float
    next_V: float
    covered: float

    def voltage_V(self, charge: FloatArray) -> FloatArray:
        """(n,) of the cell at rest for a charge in the negative electrode."""
        filling = (self.lithium_Ah - charge) / self.positive_Ah
        known = np.interp(filling, self.filling, self.potential_V)
        low, high = self.filling[0], self.filling[-1]
        ends = np.gradient(self.potential_V, self.filling)[[0, -1]]
        slopes = np.minimum(ends, -_STEEP_V)
        beyond = slopes[0] * np.minimum(filling - low, 0.0) + slopes[1] * np.maximum(filling - high, 0.0)
        return known + beyond - NEGATIVES[self.negative](charge / self.negative_Ah)

    @property
    def sure(self) -> bool:
        """Whether published curves make the cell's own so well, and electrodes of a usual size, that they are its."""
        usual = self.negative_Ah < _LARGEST_N and self.positive_Ah < _LARGEST_P
        alone = self.close_V * _NEXT <= self.next_V
        return usual and alone and self.close_V <= _SURE_V and self.covered >= _SURE_SOC

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Charge in the negative electrode of the empty and of the full cell."""
        middle = 0.5 * self.negative_Ah
        charge = middle + np.linspace(-0.5 - _BEYOND, 0.5 + _BEYOND, _DRAWN)
        rising = np.maximum.accumulate(self.voltage_V(charge))
        steps = np.concatenate([[True], np.diff(rising) > 0.0])
        low, high = np.interp(self.limits_V, rising[steps], charge[steps])
        return float(low), float(high)

    @property
    def capacity(self) -> float:
        """Of the cell, over its fresh capacity."""
        return self.ends[1] - self.ends[0]

    def open_circuit_V(self, soc: FloatArray) -> FloatArray:
        """(n,) over the state of charge between this cell's own ends."""
        low, high = self.ends
        return self.voltage_V(low + soc * (high - low))

    def less_lithium(self, share: float) -> HalfCells:
        """Without lithium that could be cycled, over the fresh capacity: it is bound in a film."""
        return replace(self, lithium_Ah=self.lithium_Ah - share)

    def less_negative(self, share: float, soc: float = 0.5) -> HalfCells:
        """Without a share of the negative material, and of the lithium in it at a state of charge."""
        lost_Ah = share * self._charge(soc)
        return replace(self, negative_Ah=self.negative_Ah * (1.0 - share), lithium_Ah=self.lithium_Ah - lost_Ah)

    def less_positive(self, share: float, soc: float = 0.5) -> HalfCells:
        """Without a share of the positive material, and of the lithium in it at a state of charge."""
        lost_Ah = share * (self.lithium_Ah - self._charge(soc))
        return replace(self, positive_Ah=self.positive_Ah * (1.0 - share), lithium_Ah=self.lithium_Ah - lost_Ah)

    def _charge(self, soc: float) -> float:
        return self.ends[0] + soc * (self.ends[1] - self.ends[0])


def half_cells(model: OwnModel) -> HalfCells | None:
    """Electrodes of a model's cell; None where it is no lithium cell against graphite.

    Parameters
    ----------
    model : with its open-circuit curve. Where published curves make it, they are taken; elsewhere the negative
        electrode is graphite in a usual cell, and the positive one what is left, as far as that falls
    """
    curve = own_curve(model)
    return None if curve is None else apart(curve)


def own_curve(model: OwnModel) -> Curve | None:
    """States of charge and voltages by which a model's cell is taken apart; None: it is none that could be."""
    low, high = model.soc_range
    soc = np.linspace(max(low, 0.0), min(high, 1.0), _MATCHED)
    curve_V = model.open_circuit_V(soc)
    if float(np.median(curve_V)) < _LEAST_V:
        return None
    return tuple(soc.tolist()), tuple(np.maximum.accumulate(curve_V).tolist())


@lru_cache(maxsize=16)
def apart(curve: Curve) -> HalfCells:
    """Electrodes that make a full cell's curve."""
    at, own_V = np.array(curve[0]), np.array(curve[1])
    every = sorted((_matched(at, own_V, n, p) for n in NEGATIVES for p in POSITIVES), key=lambda found: found[0])
    (close_V, left_V, negative, positive, window), next_V = every[0], every[1][0]
    if left_V > _GOOD_V:
        negative, window = next(iter(NEGATIVES)), (*_USUAL_N, *_USUAL_P)
    x0, x1, y0, y1 = window
    if left_V > _GOOD_V:
        filling, potential_V = _learned(y0 + at * (y1 - y0), own_V + NEGATIVES[negative](x0 + at * (x1 - x0)))
    else:
        filling = np.linspace(POSITIVES[positive].low, POSITIVES[positive].high, _TABLE)
        potential_V = POSITIVES[positive].potential_V(filling)
    close_V, covered = close_V if left_V <= _GOOD_V else left_V, float(at[-1] - at[0])
    negative_Ah, positive_Ah = 1.0 / (x1 - x0), 1.0 / (y0 - y1)
    lithium_Ah = x0 * negative_Ah + y0 * positive_Ah
    cell = HalfCells(
        negative,
        negative_Ah,
        positive_Ah,
        lithium_Ah,
        filling,
        potential_V,
        (0.0, 1.0),
        left_V,
        close_V,
        next_V,
        covered,
    )
    ends = cell.voltage_V(np.array([x0, x1]) * negative_Ah)
    # Both are those of these electrodes themselves: what the curve is off by is the same for the aged cell.
    return replace(cell, limits_V=(float(ends[0]), float(ends[1])))


def _learned(filling: FloatArray, potential_V: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The positive electrode that the cell's own curve asks for: one that falls as it is filled."""
    order = np.argsort(filling)
    return filling[order], np.minimum.accumulate(potential_V[order])


def _matched(soc: FloatArray, curve_V: FloatArray, negative: str, positive: str) -> tuple:
    """What two published curves leave of a full cell's (`close_V`, `left_V`), their names, and their fillings."""
    # Lazy: 100 ms that only a diagnosis of a lithium cell needs.
    from scipy.optimize import least_squares

    curve = POSITIVES[positive]
    # Where the curve is steep it is known the less: the state of charge is not sharp itself.
    weight = 1.0 / np.hypot(1.0, _SHARP_SOC / _SHARP_V * np.gradient(curve_V, soc))
    inner = (soc >= _INNER[0]) & (soc <= _INNER[1])
    low, high = (0.0, 0.4, curve.low + _LEAST_P, 0.0), (0.2, 1.0, curve.high, 1.0)

    smooth = np.polynomial.legendre.legvander(2.0 * soc - 1.0, len(_OFF_V) - 1)

    def windows(found: FloatArray) -> tuple[float, ...]:
        """Fillings; a flat positive electrode would as soon be filled while the cell is charged, which none is."""
        x0, x1, y0, share = found[:4].tolist()
        return x0, x1, y0, curve.low + share * (y0 - _LEAST_P - curve.low)

    def left(found: FloatArray) -> FloatArray:
        (x0, x1, y0, y1), off_V = windows(found), found[4:]
        full_V = curve.potential_V(y0 + soc * (y1 - y0)) - NEGATIVES[negative](x0 + soc * (x1 - x0))
        left_V = weight * (full_V - curve_V + smooth @ off_V)
        unusual = _SHARP_V / _UNUSUAL * (np.array([x0, x1, y0, y1]) - (*_USUAL_N, *curve.usual))
        return np.concatenate([left_V[inner], _SHARP_V / _OFF_V * off_V, unusual])

    none = np.zeros(len(_OFF_V))
    empty, full = curve.usual
    usual = (*_USUAL_N, empty, (full - curve.low) / (empty - _LEAST_P - curve.low))
    start = np.clip(usual, np.array(low) + 1e-3, np.array(high) - 1e-3)
    bounds = (np.append(low, none - _MOST_OFF_V), np.append(high, none + _MOST_OFF_V))
    scale = np.append(np.full(4, 0.1), _OFF_V)
    found = least_squares(left, np.append(start, none), bounds=bounds, x_scale=scale, max_nfev=_STEPS)
    inside, off, _ = np.split(left(found.x), [-len(_OFF_V) - 4, -4])
    close_V = float(np.sqrt(np.mean(inside**2)))
    return close_V, float(np.hypot(close_V, np.linalg.norm(off))), negative, positive, windows(found.x)
