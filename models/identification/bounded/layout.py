"""Where each coefficient of a bounded network stands, in which units, and what it must lie between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.identification.bounded.box_least_squares import Box
from models.identification.bounded.knots import Knots, hats
from models.identification.bounded.terms import Basis, Term
from models.network.regression import SignalBank, delayed

# The temperature of which the open-circuit curve is that of the network's offset.
REFERENCE_DEGC = 25.0
# The largest change of an open-circuit voltage with temperature that a cell is believed to have, as a share of the
# voltage, 1/K: 3 mV/K at 3.7 V, where lithium-ion cells are reported to have tenths of a mV/K and at their ends about
# one. Runs that warm by a few kelvin put down to it whatever else went on meanwhile (20 to 30 mV/K without a bound).
_ENTROPIC_PER_K = 8e-4
# And by how much a state of charge may seem to move with temperature, 1/K: what can be taken out in the cold is less,
# which shows where the curve is steep.
_SLIP_PER_K = 1e-3
# To see where the curve is steep few samples will do, and its bends are held with so much.
_STEEPNESS_SAMPLES = 2000
_STEEPNESS_BEND = 1e-2


@dataclass(frozen=True)
class Layout:
    """Where each coefficient stands.

    The first are the curve's values at its knots in V, then each term's gains in V per largest value of its signal.

    Attributes
    ----------
    basis, knots : what there is
    scale : (B,) largest magnitude of each term's signal, of one direction's that of the other too; of the temperature
        its distance from 25 degC
    first : (B + 1,) place of each term's first coefficient; the last: number of all
    slope_limit_V_per_K : (S,) largest change of the curve with temperature at its knots
    """

    basis: Basis
    knots: Knots
    scale: FloatArray
    first: np.ndarray
    slope_limit_V_per_K: FloatArray

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return int(self.first[-1])

    @property
    def n_curve(self) -> int:
        """Number of the curve's knots."""
        return len(self.knots.soc)

    @property
    def box(self) -> Box:
        """What each coefficient must lie between, the curve given by its first value and its increments."""
        lower, upper = np.zeros(self.size), np.full(self.size, np.inf)
        lower[0] = -np.inf
        for b, term in enumerate(self.basis.terms):
            if not term.bounded:
                part = slice(int(self.first[b]), int(self.first[b + 1]))
                upper[part] = self.slope_limit_V_per_K * self.scale[b]
                lower[part] = -upper[part]
        return Box(lower, upper)

    def places(self, term: int) -> np.ndarray:
        """Knots of a term, as places among those of the curve."""
        return _places(self.knots, self.basis.terms[term])


def _places(knots: Knots, term: Term) -> np.ndarray:
    """Knots of a term, as places among those of the curve."""
    if term.flat:
        return np.zeros(1, dtype=np.int64)
    return knots.gain if term.bounded else knots.slope


def soc_over(bank: SignalBank, axis: str) -> list[FloatArray]:
    """(n,) of each run: state of charge on the partition axis, that of the sample before."""
    return [delayed(values, 1) for values in bank.values(axis)]


def make_layout(bank: SignalBank, basis: Basis, knots: Knots) -> Layout:
    """Lay the coefficients out, with scales from the runs."""
    scale, first = [], [len(knots.soc)]
    for term in basis.terms:
        offset = 0.0 if term.bounded else REFERENCE_DEGC
        largest = max(float(np.abs(values - offset).max()) for values in either_way(bank, term))
        scale.append(max(largest, 1e-9))
        first.append(first[-1] + len(_places(knots, term)))
    limit = slope_limit(knots, _steep_curve(bank, basis.axis, knots))
    return Layout(basis, knots, np.array(scale), np.array(first), limit)


def slope_limit(knots: Knots, curve_V: FloatArray) -> FloatArray:
    """(S,) largest change of an open-circuit curve with temperature in V/K, from its values at its knots."""
    steepness_V = np.abs(np.gradient(curve_V, knots.soc))
    near = hats(knots.soc[knots.slope], knots.soc)
    return _ENTROPIC_PER_K * float(np.abs(curve_V).mean()) + _SLIP_PER_K * (steepness_V @ near) / near.sum(axis=0)


def _steep_curve(bank: SignalBank, axis: str, knots: Knots) -> FloatArray:
    """(n,) an open-circuit curve to see where it is steep: voltage over state of charge and current, bends held."""
    voltage, current = (
        np.concatenate([getattr(run, name) for run in bank.runs]) for name in ("voltage_V", "current_A")
    )
    chosen = counted(voltage, max(1, len(voltage) // _STEEPNESS_SAMPLES))
    rows = np.column_stack([hats(knots.soc, np.concatenate(soc_over(bank, axis))[chosen]), current[chosen]])
    bends = np.pad(np.diff(np.eye(len(knots.soc)), 2, axis=0), ((0, 0), (0, 1)))
    held = np.vstack([rows / np.sqrt(len(rows)), np.sqrt(_STEEPNESS_BEND / len(bends)) * bends])
    wanted = np.concatenate([voltage[chosen] / np.sqrt(len(rows)), np.zeros(len(bends))])
    return np.linalg.lstsq(held, wanted, rcond=None)[0][:-1]


def counted(voltage_V: FloatArray, keep_every: int) -> np.ndarray:
    """Which of the samples of all runs are counted: every n-th, where it has a voltage."""
    place = np.arange(0, len(voltage_V), keep_every)
    return place[~np.isnan(voltage_V[place])]


def either_way(bank: SignalBank, term: Term) -> list[FloatArray]:
    """Values of a term's signal over each run, and of its counterpart where the current flows the other way.

    What only discharge loses is in a charge no more than the current sensor's noise. By that measure a gain of a volt
    would be small, and would be thousands at the first discharge.
    """
    own = bank.values(term.signal)
    return own if term.mirrored == term.signal else own + bank.values(term.mirrored)
