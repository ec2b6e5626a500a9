"""A cell as strands side by side that share its current: truth whose relaxation is charge that moves between them.

    i_k = (v - E_k) / r_k,   E_k = U(z_k) + x_k + w_k,   sum_k i_k = i - i_leak,   V = v + R_series i

A wound or stacked cell is not the same everywhere, and acts as cells in parallel do (Bruen and Marco, J. Power Sources
310, 2016). Each strand k has its own charge, resistance r_k and one slow voltage w_k. Where the open-circuit curve is
flat they drift apart under load, and come together again in a rest for as long as its slope allows, so that relaxation
has no time constant of its own. Memory x_k is a play, the dead way of a worn gear: the voltage follows the charge only
after it has moved by a distance (Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989). Kinetics are a power
law of the current with other factors on charge and discharge; resistances follow temperature by a polynomial in its
logarithm. One body takes the heat.

Nothing here is shared with `simulators.cell`, with another truth, or with any model of the product.
"""

import math
from dataclasses import dataclass

import numpy as np

from simulators.cell import CellOutput

__all__ = ["StrandCell", "StrandParameters"]

_REFERENCE_DEGC = 25.0
_LONGEST_STEP_S = 2.0
_GRID = np.linspace(-0.05, 1.05, 1101)


@dataclass(frozen=True, slots=True, kw_only=True)
class StrandParameters:
    """Constants of such a cell.

    Attributes
    ----------
    capacity_Ah : counted between SoC 0 and 1
    full_V, steps : voltage at SoC 1, and (height in V, place, width) of the tanh steps that the curve is a sum of
    tilt_V, knee_V, knee_at : straight rise over all of it, fall towards empty and where that begins
    moved_V, moved_at : height and place of a part by which the curve has moved
    share : (K,) of the capacity in each strand
    strand_Ohm : (K,) times their shares, so that all would be the same in a uniform cell
    bend, bend_A : exponent by which resistance falls with the current, 0 for none, and from which current on
    on_charge : resistance is more by this share on charge
    slow_Ohm, slow_s, slow_A : of each strand's slow voltage, which saturates at a current
    play_V, play_wide : height of the memory, and the distance in SoC that it takes
    cold, cold_bend : logarithm of resistances per 10 K of cold, and its bend
    near_empty : resistance is more by this share at SoC 0
    growth_per_Ah, series_Ohm, leakage_A : as named
    entropy_V_per_K : slope of the open-circuit voltage with temperature, at SoC 0 and at SoC 1
    heat_J_per_K, cooling_W_per_K : of the body, and to the ambient
    """

    capacity_Ah: float
    full_V: float
    steps: tuple[tuple[float, float, float], ...]
    tilt_V: float
    knee_V: float
    knee_at: float
    share: tuple[float, ...]
    strand_Ohm: tuple[float, ...]
    bend: float
    bend_A: float
    slow_Ohm: float
    slow_s: float
    slow_A: float
    play_V: float
    play_wide: float
    cold: float
    cold_bend: float
    entropy_V_per_K: tuple[float, float]
    heat_J_per_K: float
    cooling_W_per_K: float
    on_charge: float = 0.0
    near_empty: float = 0.0
    moved_V: float = 0.0
    moved_at: float = 0.5
    growth_per_Ah: float = 0.0
    series_Ohm: float = 0.0
    leakage_A: float = 0.0

    def curve_V(self) -> np.ndarray:
        """(n,) open-circuit voltage over `_GRID`."""
        out = self.tilt_V * (_GRID - 1.0) - self.knee_V * np.exp(-(_GRID + 0.05) / self.knee_at)
        for height_V, place, width in self.steps:
            out += 0.5 * height_V * (np.tanh((_GRID - place) / width) - math.tanh((1.0 - place) / width))
        return self.full_V + out + self.moved_V * np.exp(-(((_GRID - self.moved_at) / 0.1) ** 2))


class StrandCell:
    """Such a cell with its state.

    Parameters
    ----------
    parameters : constants
    soc : state of charge at the start, the same in all strands, at rest
    ambient_degC : the cell starts at it
    """

    def __init__(self, parameters: StrandParameters, soc: float = 0.5, ambient_degC: float = 25.0) -> None:
        p = self.parameters = parameters
        self.ambient_degC = ambient_degC
        self._curve_V = p.curve_V()
        self._share = np.array(p.share) / sum(p.share)
        self._base_Ohm = np.array(p.strand_Ohm) / self._share
        self._soc = np.full(len(self._share), soc)
        # Where the last move was a charge, the play stands at its upper end.
        self._followed = self._soc - 0.5 * p.play_wide
        self._slow_V = np.zeros(len(self._share))
        self._strand_A = np.zeros(len(self._share))
        self._degC, self._throughput_Ah, self._heat_J = ambient_degC, 0.0, 0.0

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """Hold a current (positive charges) for a time and return the truth at its end; 0 s only looks."""
        n = math.ceil(dt_s / _LONGEST_STEP_S)
        voltage = self._shared(current_A) if n == 0 else 0.0
        for _ in range(n):
            voltage = self._advance(current_A, dt_s / n)
        open_V, play_V = float(self._share @ self._open()), float(self._share @ self._play())
        terminal = voltage + self.parameters.series_Ohm * current_A
        return CellOutput(terminal, self._degC, float(self._share @ self._soc), open_V + play_V, play_V, self._heat_J)

    def _advance(self, current_A: float, dt_s: float) -> float:
        """Move every state; the voltage at the end."""
        p = self.parameters
        voltage = self._shared(current_A)
        self._soc += self._strand_A * dt_s / (3600.0 * p.capacity_Ah * self._share)
        half = 0.5 * p.play_wide
        self._followed = np.clip(self._followed, self._soc - half, self._soc + half)
        of_whole = self._strand_A / self._share
        driven = p.slow_Ohm * self._factor() * p.slow_A * np.tanh(of_whole / p.slow_A)
        self._slow_V += (driven - self._slow_V) * -math.expm1(-dt_s / p.slow_s)
        self._throughput_Ah += abs(current_A) * dt_s / 3600.0
        rested_V = self._open() + self._play()
        heat_W = float(self._strand_A @ (voltage - rested_V)) + p.leakage_A * voltage
        heat_W += float(self._strand_A @ self._entropy()) * (self._degC + 273.15)
        cooled_W = p.cooling_W_per_K * (self._degC - self.ambient_degC)
        self._degC += (heat_W - cooled_W) * dt_s / p.heat_J_per_K
        self._heat_J += heat_W * dt_s
        return self._shared(current_A)

    def _shared(self, current_A: float) -> float:
        """Share the current out, and the voltage that all strands have then; resistances by the last shares."""
        p = self.parameters
        of_whole = self._strand_A / self._share
        bent = (1.0 + np.abs(of_whole) / p.bend_A) ** -p.bend
        bent *= 1.0 + p.on_charge * (of_whole > 0.0)
        bent *= 1.0 + p.near_empty * np.exp(-np.maximum(self._soc, 0.0) / 0.12)
        ohm = self._base_Ohm * bent * self._factor()
        inner_V = self._open() + self._play() + self._slow_V
        voltage = (current_A - p.leakage_A + float((inner_V / ohm).sum())) / float((1.0 / ohm).sum())
        self._strand_A = (voltage - inner_V) / ohm
        return voltage

    def _factor(self) -> float:
        """Of all resistances, by temperature and age."""
        p = self.parameters
        tens = (_REFERENCE_DEGC - self._degC) / 10.0
        return math.exp(p.cold * tens + p.cold_bend * tens * tens) * (1.0 + p.growth_per_Ah * self._throughput_Ah)

    def _entropy(self) -> np.ndarray:
        empty, full = self.parameters.entropy_V_per_K
        return empty + (full - empty) * self._soc

    def _open(self) -> np.ndarray:
        """(K,) open-circuit voltage of each strand without its memory."""
        return np.interp(self._soc, _GRID, self._curve_V) + self._entropy() * (self._degC - _REFERENCE_DEGC)

    def _play(self) -> np.ndarray:
        """(K,) memory of each strand in V, between half its height down and up."""
        p = self.parameters
        return p.play_V * np.clip((self._soc - self._followed) / p.play_wide, -0.5, 0.5)
