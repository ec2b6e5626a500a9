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
from models.effects.electrode_match import USUAL_NEGATIVE, Ahead, Loaded, Match, loaded, matches
from models.effects.half_cell_curves import NEGATIVES, POSITIVES
from models.effects.once_a_model import once_a_model
from models.effects.view import OwnModel

# Points of the charge on which the full cell's curve is drawn, and of a table of an electrode's.
_DRAWN, _TABLE = 2401, 600
# Charge beyond empty and full that is drawn.
_BEYOND = 0.35
# Points of the full cell's curve that an electrode is learned from.
_LEARNED = 40
# A match that is off by more than this, V, is none: electrodes of other materials.
_GOOD_V, _NONE_V = 0.004, 1.0
# One that is off by less than this over so much of the state of charge is hardly by chance: of 18 simulated cells of
# PyBaMM the right pairs are off by 0.5 to 3.5 mV.
_SURE_V, _SURE_SOC, _SURE_CHANCE = 0.0037, 0.8, 0.7
# No cell has larger electrodes than these over its own capacity (the largest negative one of those whose curves are
# here has 1.6, Kim et al. 2011); a small part of a curve makes many others.
_LARGEST_N, _LARGEST_P = 1.7, 2.6
# How far a right pair is off is not known: the likelihood of each is a power of its cost, by the independent points of
# a curve (Jeffreys' prior for the scale), above a cost that noise alone makes; and the least probability looked at.
_INDEPENDENT, _NOISE, _LEAST_CHANCE = 12, 10.0, 0.02
# Fillings of the counterpart of graphite in a usual cell, empty and full (Birkl et al. 2017).
USUAL_POSITIVE = (0.93, 0.35)
# No positive electrode is flatter than this beyond where its curve is known, V per filling.
_STEEP_V = 1.0
# Lithium cells against graphite rest above this when half full; no other cell's curve is taken apart.
_LEAST_V = 2.8


@dataclass(frozen=True)
class Curve:
    """What a model says of its cell, as far as electrodes are found in it.

    Attributes
    ----------
    soc, voltage_V : its open-circuit curve
    loaded : its voltage under constant currents
    """

    soc: tuple[float, ...]
    voltage_V: tuple[float, ...]
    loaded: Loaded


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
    left_V : by how much these curves are off the cell's voltage under constant currents
    covered : states of charge that the cell's own curve is known over
    chance : how likely these two curves are the cell's, of all that are published
    ahead : by how much the particles' surfaces are, under current; of the fresh cell's state of charge
    """

    negative: str
    negative_Ah: float
    positive_Ah: float
    lithium_Ah: float
    filling: FloatArray
    potential_V: FloatArray
    limits_V: tuple[float, float]
    left_V: float
    covered: float
    chance: float
    ahead: Ahead = Ahead()

    def voltage_V(self, charge: FloatArray) -> FloatArray:
        """(n,) of the cell at rest for a charge in the negative electrode."""
        return self._positive_V(charge) - self._negative_V(charge)

    def _negative_V(self, charge: FloatArray) -> FloatArray:
        return NEGATIVES[self.negative](charge / self.negative_Ah)

    def _positive_V(self, charge: FloatArray) -> FloatArray:
        filling = (self.lithium_Ah - charge) / self.positive_Ah
        known = np.interp(filling, self.filling, self.potential_V)
        low, high = self.filling[0], self.filling[-1]
        ends = np.gradient(self.potential_V, self.filling)[[0, -1]]
        slopes = np.minimum(ends, -_STEEP_V)
        beyond = slopes[0] * np.minimum(filling - low, 0.0) + slopes[1] * np.maximum(filling - high, 0.0)
        return known + beyond

    @property
    def published(self) -> bool:
        """Whether published curves make the cell's own, these or others."""
        return self.left_V <= _GOOD_V and self.covered >= _SURE_SOC

    @property
    def sure(self) -> bool:
        """Whether published curves make the cell's own so well that they are its."""
        return self.left_V <= _SURE_V and self.covered >= _SURE_SOC and self.chance >= _SURE_CHANCE

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

    def electrodes_V(self, soc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Potentials over lithium, each (n,), of the negative and of the positive electrode, over the same."""
        low, high = self.ends
        charge = low + soc * (high - low)
        return self._negative_V(charge), self._positive_V(charge)

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


@once_a_model
def own_curve(model: OwnModel) -> Curve | None:
    """What a model's cell is taken apart by; None: it is none that could be."""
    low, high = model.soc_range
    soc = np.linspace(max(low, 0.0), min(high, 1.0), _LEARNED)
    curve_V = model.open_circuit_V(soc)
    if float(np.median(curve_V)) < _LEAST_V:
        return None
    return Curve(tuple(soc.tolist()), tuple(np.maximum.accumulate(curve_V).tolist()), loaded(model))


def apart(curve: Curve) -> HalfCells:
    """Electrodes that make a full cell's curve: the likeliest."""
    return likely(curve)[0]


@lru_cache(maxsize=16)
def likely(curve: Curve) -> tuple[HalfCells, ...]:
    """Electrodes that may make a full cell's curve, the likeliest first."""
    covered = curve.soc[-1] - curve.soc[0]
    every = [each for each in matches(curve.loaded) if _usual(each)]
    if not every or every[0].left_V > _GOOD_V:
        return (_learned(curve, every[0].left_V if every else _NONE_V),)
    costs = np.array([each.cost for each in every]) + _NOISE
    weights = (costs[0] / costs) ** (0.5 * _INDEPENDENT)
    chances = zip(every, (weights / weights.sum()).tolist(), strict=True)
    return tuple(_published(each, covered, chance) for each, chance in chances if chance > _LEAST_CHANCE)


def _usual(found: Match) -> bool:
    x0, x1, y0, y1 = found.window
    return (x1 - x0) * _LARGEST_N > 1.0 and (y0 - y1) * _LARGEST_P > 1.0


def _published(found: Match, covered: float, chance: float) -> HalfCells:
    curve = POSITIVES[found.positive]
    filling = np.linspace(curve.low, curve.high, _TABLE)
    cell = _cell(found.negative, found.window, filling, curve.potential_V(filling), found.left_V, covered, chance)
    return replace(cell, ahead=found.ahead)


def _learned(curve: Curve, left_V: float) -> HalfCells:
    """Graphite in a usual cell, and the positive electrode that the curve asks for: one that falls as it is filled."""
    at, own_V = np.array(curve.soc), np.array(curve.voltage_V)
    negative, window = next(iter(NEGATIVES)), (*USUAL_NEGATIVE, *USUAL_POSITIVE)
    x0, x1, y0, y1 = window
    filling, potential_V = y0 + at * (y1 - y0), own_V + NEGATIVES[negative](x0 + at * (x1 - x0))
    order = np.argsort(filling)
    falling_V = np.minimum.accumulate(potential_V[order])
    return _cell(negative, window, filling[order], falling_V, left_V, float(at[-1] - at[0]), 1.0)


def _cell(
    negative: str,
    window: tuple[float, float, float, float],
    filling: FloatArray,
    potential_V: FloatArray,
    left_V: float,
    covered: float,
    chance: float,
) -> HalfCells:
    x0, x1, y0, y1 = window
    negative_Ah, positive_Ah = 1.0 / (x1 - x0), 1.0 / (y0 - y1)
    lithium_Ah = x0 * negative_Ah + y0 * positive_Ah
    electrodes = (negative, negative_Ah, positive_Ah, lithium_Ah, filling, potential_V)
    cell = HalfCells(*electrodes, (0.0, 1.0), left_V, covered, chance)
    ends = cell.voltage_V(np.array([x0, x1]) * negative_Ah)
    # Both are those of these electrodes themselves: what the curve is off by is the same for the aged cell.
    return replace(cell, limits_V=(float(ends[0]), float(ends[1])))
