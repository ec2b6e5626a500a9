"""Two published half-cell curves matched to what a model says of its cell under constant currents.

A run at one current tells an open-circuit curve from what the current makes of it by its steps alone. So charge and
discharge are matched themselves: particles' surfaces run ahead of the mean filling, further at one end than at the
other, because solids let lithium through the less the fuller they are, or the emptier; and the rest of what the current
makes goes with its size, in either direction alike, over a smooth polynomial of the state of charge; by a smaller and
simpler one the two directions differ. Both are left aside with normal priors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.effects.half_cell_curves import NEGATIVES, POSITIVES
from models.effects.view import OwnModel, View

# Points of each direction that are looked at, and where: nearer to empty, and to full while charging, where a charge
# holds its voltage, the current makes most of it.
_POINTS, _CHARGING, _DISCHARGING = 60, (0.06, 0.88), (0.06, 0.97)
# How sharp a voltage is, V, and how much less so where the curve is steep: per V per SoC.
_SHARP_V, _SHARP_STEEP = 0.003, 0.5
# What the usual current makes of a voltage, by Legendre polynomials over the state of charge, V: alike in both
# directions, and not.
_ALIKE_V, _APART_V = np.array([0.05, 0.05, 0.05, 0.02, 0.02]), np.array([0.02, 0.01, 0.01])
# By how much the surfaces are ahead, SoC per C-rate, and at most; and by how much more that is full, and less empty.
# Without the latter cells of Ecker et al. (2015) were found with graphite that is filled to 0.07 to 0.09 when they are
# empty, where 0.003 to 0.005 are true.
_LEAD, _MOST_LEAD = 0.1, 0.3
_TILT, _MOST_TILT = 0.05, 0.2
# Fillings of graphite in a usual cell, empty and full (Birkl et al., J. Power Sources 341, 2017).
USUAL_NEGATIVE = (0.03, 0.85)
# Smallest window of an electrode that is used, and most filling of an empty negative one.
_LEAST_WINDOW, _MOST_EMPTY = 0.25, 0.3
# Beyond these fillings formulas rise out of all bounds, and further off a voltage is as wrong as it can be.
_FILLINGS, _FAR_V = (0.0, 1.1), 5.0
# By how much a filling, empty or full, is usually another one, where a flat curve does not tell.
_UNUSUAL = 0.2
# Where a search begins: lead of the surfaces in SoC per C-rate, and filling of an empty negative electrode; and the
# evaluations that it has.
_STARTS, _EVALUATIONS = ((0.02, 0.03), (0.12, 0.03), (0.05, 0.2)), 40
# Steps of the differences that stand for derivatives: the root of a double's precision.
_DIFFERENCE = 1.5e-8
# Pairs whose cost is that much above the best one's are not looked for again.
_HOPELESS = 250.0

# States of charge, voltages and currents over the capacity, 1/h.
Loaded = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class Ahead:
    """By how much the particles' surfaces are ahead of what they are filled with in the mean, under current.

    Attributes
    ----------
    negative, positive : of either electrode in the half-full cell, SoC per C-rate
    negative_tilt, positive_tilt : by how much more that is when full, and less when empty
    """

    negative: float = 0.0
    positive: float = 0.0
    negative_tilt: float = 0.0
    positive_tilt: float = 0.0

    def of_negative(self, soc: FloatArray, rate: FloatArray) -> FloatArray:
        """(n,) SoC by which the negative electrode's surface is ahead at states of charge and C-rates."""
        return (self.negative + self.negative_tilt * (2.0 * soc - 1.0)) * rate

    def of_positive(self, soc: FloatArray, rate: FloatArray) -> FloatArray:
        """(n,) the same of the positive electrode's."""
        return (self.positive + self.positive_tilt * (2.0 * soc - 1.0)) * rate


@dataclass(frozen=True)
class Match:
    """A pair of published curves as it fits a cell best.

    Attributes
    ----------
    negative, positive : names of the curves
    window : fillings of the negative electrode, empty and full, and of the positive one
    cost : twice the negative logarithm of its likelihood, up to a constant
    left_V : by how much it is off, of which both what it leaves and what the current would have to make are part
    ahead : by how much the surfaces are
    """

    negative: str
    positive: str
    window: tuple[float, float, float, float]
    cost: float
    left_V: float
    ahead: Ahead


def loaded(model: OwnModel) -> Loaded:
    """A model's voltage from empty to full, and back, at the usual current of its training runs."""
    parts = [_direction(model, 1.0, *_CHARGING), _direction(model, -1.0, *_DISCHARGING)]
    soc, voltage_V, rate = (np.concatenate(each) for each in zip(*parts, strict=True))
    return tuple(soc.tolist()), tuple(voltage_V.tolist()), tuple(rate.tolist())


def _direction(model: OwnModel, sign: float, low: float, high: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    least_A, most_A = model.domain["current_A"]
    largest_A = most_A if sign > 0.0 else -least_A
    load_A = min(model.usual_A, largest_A) if largest_A > 0.0 else model.usual_A
    hours = model.capacity_Ah / load_A
    n = int(3600.0 * hours / model.dt_s) + 1
    current_A = np.full(n, sign * load_A)
    current_A[0] = 0.0
    degC, time_s = np.full(n, model.trained_degC), np.arange(n) * model.dt_s
    charge_Ah = np.cumsum(current_A) * model.dt_s / 3600.0
    run = GridRun(
        "constant current", model.dt_s, time_s, current_A, 0.0 * degC, degC, None, charge_Ah, None, (0,), degC > -1e3
    )
    first, last = model.soc_range
    begins = max(first, 0.0) if sign > 0.0 else min(last, 1.0)
    view = View(model, run, begins, np.unique(np.linspace(1, n - 1, _POINTS).astype(np.int64)))
    soc = view.soc[view.index]
    inside = (soc >= max(low, first)) & (soc <= min(high, last))
    return soc[inside], view.voltage_V[inside], np.full(int(inside.sum()), sign / hours)


def matches(given: Loaded) -> list[Match]:
    """Every pair of published curves, the best first."""
    cell = _Cell.of(given)
    every = [_matched(cell, n, p, *_STARTS[0]) for n in NEGATIVES for p in POSITIVES]
    least = min(each.cost for each in every)
    for k, each in enumerate(every):
        if each.cost < least + _HOPELESS:
            others = [_matched(cell, each.negative, each.positive, *start) for start in _STARTS[1:]]
            every[k] = min((each, *others), key=lambda one: one.cost)
    return sorted(every, key=lambda each: each.cost)


@dataclass(frozen=True)
class _Cell:
    """What is matched.

    Attributes
    ----------
    soc, voltage_V, rate : (n,)
    weight : (n,) of each voltage, 1/V
    whiten : (n, n) inverse root of the covariance of noise and of what the current makes, over the weights
    """

    soc: FloatArray
    voltage_V: FloatArray
    rate: FloatArray
    weight: FloatArray
    whiten: FloatArray

    @classmethod
    def of(cls, given: Loaded) -> _Cell:
        """Prepare it."""
        soc, voltage_V, rate = (np.array(each) for each in given)
        slope_V = np.empty(len(soc))
        for own in (rate > 0.0, rate < 0.0):
            slope_V[own] = np.gradient(voltage_V[own], soc[own])
        weight = 1.0 / (_SHARP_V * np.hypot(1.0, _SHARP_STEEP * slope_V))
        load = rate / float(np.sqrt(np.mean(rate**2)))
        alike = np.polynomial.legendre.legvander(2.0 * soc - 1.0, len(_ALIKE_V) - 1) * load[:, None]
        apart = np.polynomial.legendre.legvander(2.0 * soc - 1.0, len(_APART_V) - 1)
        columns = np.hstack([alike * _ALIKE_V, apart * _APART_V]) * weight[:, None]
        lower = np.linalg.cholesky(np.eye(len(soc)) + columns @ columns.T)
        return cls(soc, voltage_V, rate, weight, np.linalg.inv(lower))


def _matched(cell: _Cell, negative: str, positive: str, lead: float, x_empty: float) -> Match:
    """The best match of a pair, looked for from a lead of the surfaces and a filling of the empty negative one on."""
    # Lazy: 100 ms that only a diagnosis of a lithium cell needs.
    from scipy.optimize import least_squares

    curve, other = POSITIVES[positive], NEGATIVES[negative]

    def window(found: FloatArray) -> FloatArray:
        """(4, m) fillings; a flat positive electrode would as soon be filled while the cell is charged: none is."""
        x0, x1, y0, share = found[:4]
        return np.array([x0, x1, y0, curve.low + share * (y0 - _LEAST_WINDOW - curve.low)])

    def costs_of(found: FloatArray) -> FloatArray:
        """(n + 8, m) roots of what (8, m) matches cost."""
        windows = window(found)
        (x0, x1, y0, y1), ahead = windows[:, :, None], Ahead(*found[4:, :, None])
        in_positive = np.clip(y0 + (cell.soc + ahead.of_positive(cell.soc, cell.rate)) * (y1 - y0), *_FILLINGS)
        in_negative = np.clip(x0 + (cell.soc + ahead.of_negative(cell.soc, cell.rate)) * (x1 - x0), *_FILLINGS)
        off_V = cell.voltage_V - curve.potential_V(in_positive) + other(in_negative)
        off = cell.weight * np.clip(off_V, -_FAR_V, _FAR_V)
        unusual = (windows - np.array((*USUAL_NEGATIVE, *curve.usual))[:, None]) / _UNUSUAL
        return np.concatenate([cell.whiten @ off.T, unusual, found[4:6] / _LEAD, found[6:] / _TILT])

    def slopes(found: FloatArray) -> FloatArray:
        """(n + 8, 8) derivatives by differences, all of them from one call."""
        step = np.where(found < 0.0, -_DIFFERENCE, _DIFFERENCE)
        step = np.where((found + step > high) | (found + step < low), -step, step)
        every = costs_of(found[:, None] + np.column_stack([np.zeros(len(found)), np.diag(step)]))
        return (every[:, 1:] - every[:, :1]) / step

    low = np.array([0.0, 0.4, curve.low + _LEAST_WINDOW, 0.0, 0.0, 0.0, -_MOST_TILT, -_MOST_TILT])
    high = np.array([_MOST_EMPTY, 1.0, curve.high, 1.0, _MOST_LEAD, _MOST_LEAD, _MOST_TILT, _MOST_TILT])
    empty, full = curve.usual
    share = (full - curve.low) / (empty - _LEAST_WINDOW - curve.low)
    start = np.clip((x_empty, USUAL_NEGATIVE[1], empty, share, lead, lead, 0.0, 0.0), low + 1e-3, high - 1e-3)
    scale = np.array([0.1, 0.1, 0.1, 0.1, 0.05, 0.05, 0.05, 0.05])
    with np.errstate(over="ignore"):
        found = least_squares(
            lambda at: costs_of(at[:, None])[:, 0],
            start,
            jac=slopes,  # pyright: ignore[reportArgumentType]
            bounds=(low, high),
            x_scale=scale,
            max_nfev=_EVALUATIONS,
        )
    cost = 2.0 * float(found.cost)
    left_V = _SHARP_V * float(np.sqrt(cost / len(cell.soc)))
    x0, x1, y0, y1 = window(found.x[:, None])[:, 0].tolist()
    return Match(negative, positive, (x0, x1, y0, y1), cost, left_V, Ahead(*found.x[4:].tolist()))
