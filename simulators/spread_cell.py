"""A cell as a continuous spread of relaxation times with relays for its loop: truth that no few branches are.

    v = U(soc) + s(soc) (T_core - 25 degC) + V_loop + R(soc, T) i / sqrt(1 + |i| / I_knee) + sum_k v_k + R_series i

The overvoltages stand for constant-phase elements: two dozen branches over five decades of time, each a share of a
power law in its time constant (Oustaloup et al., IEEE Trans. Circuits Syst. I 47, 2000). The loop is a Preisach sum of
relays over the state of charge (Mayergoyz, Mathematical Models of Hysteresis, 1991, ch. 1): each switches up at one
state of charge and down at a lower one, so that inner loops close and outer ones wipe them out. Resistance follows
temperature by Vogel, Fulcher and Tammann's law, falls with the root of the current, and core and case have
temperatures of their own; the case is what a sensor sees. The open-circuit curve is an integral of positive bumps.

Nothing here is shared with `simulators.cell`, with another truth, or with any model of the product.
"""

import math
from dataclasses import dataclass

import numpy as np

from simulators.cell import CellOutput

__all__ = ["SpreadCell", "SpreadParameters"]

_REFERENCE_DEGC = 25.0
_BRANCHES = np.geomspace(0.4, 40_000.0, 24)
_FASTEST_SPLIT_S = 60.0
_PLACES, _WIDTHS = 60, 12
_LONGEST_STEP_S = 5.0
_GRID = np.linspace(-0.02, 1.02, 1041)


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadParameters:
    """Constants of such a cell.

    Attributes
    ----------
    capacity_Ah : counted between SoC 0 and 1
    empty_V, bumps : voltage at SoC 0, and (rise in V, centre, width) of the bumps whose integral the curve is
    moved_V, moved_at : height and place of a part by which the curve has moved
    ohmic_Ohm, knee_A : at once and at a small current; the current from which on it falls with its root
    ohmic_at_empty_Ohm, on_charge, growth_per_Ah, series_Ohm : more of it near empty, its share more on charge, its
        relative growth with each ampere-hour, and what stands outside of the cell
    spread_Ohm, exponent : of the fast part of the spread, and of its power law
    slow_Ohm, slow_exponent : of the part slower than a minute
    freezing_degC, brittle_K : of Vogel, Fulcher and Tammann: resistances grow as exp(brittle / (T - freezing))
    loop_V, loop_wide : half the width of the outer loop, and how wide in SoC the relays are
    leakage_A : flows inside
    entropy_V_per_K : slope of the open-circuit voltage with temperature, at SoC 0 and at SoC 1
    core_J_per_K, case_J_per_K, core_W_per_K, cooling_W_per_K : core, case, between them, and to the ambient
    """

    capacity_Ah: float
    empty_V: float
    bumps: tuple[tuple[float, float, float], ...]
    ohmic_Ohm: float
    knee_A: float
    spread_Ohm: float
    exponent: float
    slow_Ohm: float
    slow_exponent: float
    freezing_degC: float
    brittle_K: float
    loop_V: float
    loop_wide: float
    entropy_V_per_K: tuple[float, float]
    core_J_per_K: float
    case_J_per_K: float
    core_W_per_K: float
    cooling_W_per_K: float
    moved_V: float = 0.0
    moved_at: float = 0.5
    ohmic_at_empty_Ohm: float = 0.0
    on_charge: float = 0.0
    growth_per_Ah: float = 0.0
    series_Ohm: float = 0.0
    leakage_A: float = 0.0

    def curve_V(self) -> np.ndarray:
        """(n,) open-circuit voltage over `_GRID`; straight parts of bumps never fall."""
        out = np.full(len(_GRID), self.empty_V)
        for rise_V, centre, width in self.bumps:
            step = 1.0 / (1.0 + np.exp(-(_GRID - centre) / width))
            out += rise_V * (step - 1.0 / (1.0 + math.exp(centre / width)))
        return out + self.moved_V * np.exp(-(((_GRID - self.moved_at) / 0.12) ** 2))


class SpreadCell:
    """Such a cell with its state.

    Parameters
    ----------
    parameters : constants
    soc : state of charge at the start, at rest, where the loop was left by a charge from empty
    ambient_degC : the cell starts at it
    """

    def __init__(self, parameters: SpreadParameters, soc: float = 0.5, ambient_degC: float = 25.0) -> None:
        p = self.parameters = parameters
        self.ambient_degC = ambient_degC
        self._soc, self._core_degC, self._case_degC = soc, ambient_degC, ambient_degC
        self._curve_V = p.curve_V()
        fast = _BRANCHES < _FASTEST_SPLIT_S
        weight = np.where(fast, _BRANCHES**p.exponent, _BRANCHES**p.slow_exponent)
        total = np.where(fast, weight[fast].sum(), weight[~fast].sum())
        self._branch_Ohm = np.where(fast, p.spread_Ohm, p.slow_Ohm) * weight / total
        self._branch_V = np.zeros(len(_BRANCHES))
        self._decay_of: tuple[float, np.ndarray] = (0.0, np.ones(len(_BRANCHES)))
        place, width = (np.arange(_PLACES) + 0.5) / _PLACES, (np.arange(_WIDTHS) + 0.5) / _WIDTHS
        centre, wide = np.meshgrid(1.2 * place - 0.1, p.loop_wide * (0.1 + 1.9 * width), indexing="ij")
        self._centre = centre.ravel()
        self._up, self._down = (centre + 0.5 * wide).ravel(), (centre - 0.5 * wide).ravel()
        # A narrow relay weighs more than a wide one.
        self._weight = np.tile(np.exp(-1.5 * width), _PLACES)
        self._relays = np.where(self._up < soc, 1.0, -1.0)
        self._throughput_Ah, self._heat_J = 0.0, 0.0

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """Hold a current (positive charges) for a time and return the truth at its end; 0 s only looks."""
        n = math.ceil(dt_s / _LONGEST_STEP_S)
        open_V, loop_V, lost_V = self._parts(current_A) if n == 0 else (0.0, 0.0, 0.0)
        for _ in range(n):
            open_V, loop_V, lost_V = self._advance(current_A, dt_s / n)
        voltage = open_V + loop_V + lost_V + self.parameters.series_Ohm * current_A
        return CellOutput(voltage, self._case_degC, self._soc, open_V + loop_V, loop_V, self._heat_J)

    def _advance(self, current_A: float, dt_s: float) -> tuple[float, float, float]:
        """Move every state; what the voltage is made of at the end."""
        p = self.parameters
        inner_A = current_A - p.leakage_A
        self._soc += inner_A * dt_s / (3600.0 * p.capacity_Ah)
        self._relays[self._up <= self._soc] = 1.0
        self._relays[self._down >= self._soc] = -1.0
        factor = self._factor(inner_A)
        known_s, decay = self._decay_of
        if known_s != dt_s:
            decay = np.exp(-dt_s / _BRANCHES)
            self._decay_of = dt_s, decay
        self._branch_V += (factor * inner_A * self._branch_Ohm - self._branch_V) * (1.0 - decay)
        self._throughput_Ah += abs(current_A) * dt_s / 3600.0
        open_V, loop_V, lost_V = self._parts(current_A)
        heat_W = lost_V * inner_A + p.leakage_A * open_V + inner_A * (self._core_degC + 273.15) * self._entropy()
        flow_W = p.core_W_per_K * (self._core_degC - self._case_degC)
        cooled_W = p.cooling_W_per_K * (self._case_degC - self.ambient_degC)
        self._core_degC += (heat_W - flow_W) * dt_s / p.core_J_per_K
        self._case_degC += (flow_W - cooled_W) * dt_s / p.case_J_per_K
        self._heat_J += heat_W * dt_s
        return open_V, loop_V, lost_V

    def _factor(self, current_A: float) -> float:
        """Of all resistances, by the core's temperature, age and direction."""
        p = self.parameters
        cold = p.brittle_K * (
            1.0 / max(self._core_degC - p.freezing_degC, 20.0) - 1.0 / (_REFERENCE_DEGC - p.freezing_degC)
        )
        return math.exp(cold) * (1.0 + p.growth_per_Ah * self._throughput_Ah) * (1.0 + p.on_charge * (current_A > 0.0))

    def _entropy(self) -> float:
        empty, full = self.parameters.entropy_V_per_K
        return empty + (full - empty) * self._soc

    def _parts(self, current_A: float) -> tuple[float, float, float]:
        """Open-circuit voltage without the loop, the loop, and what is lost inside."""
        p = self.parameters
        inner_A = current_A - p.leakage_A
        place = (self._soc - _GRID[0]) / (_GRID[1] - _GRID[0])
        at = min(max(int(place), 0), len(_GRID) - 2)
        open_V = float(self._curve_V[at] + (place - at) * (self._curve_V[at + 1] - self._curve_V[at]))
        open_V += self._entropy() * (self._core_degC - _REFERENCE_DEGC)
        # Relays far from where the cell is have switched long ago and say only what is the same everywhere. Those near
        # it lag behind: while charge goes in, more of them are still down than up, and the voltage stands higher.
        away = ((self._centre - self._soc) / p.loop_wide) ** 2
        # The nearest count however far they are: beyond empty or full all weights would vanish.
        weight = self._weight * np.exp(float(away.min()) - away)
        loop_V = -p.loop_V * float(weight @ self._relays) / float(weight.sum())
        ohmic = p.ohmic_Ohm / math.sqrt(1.0 + abs(inner_A) / p.knee_A) + p.ohmic_at_empty_Ohm * max(
            0.0, 1.0 - self._soc / 0.25
        )
        return open_V, loop_V, self._factor(inner_A) * ohmic * inner_A + float(self._branch_V.sum())
