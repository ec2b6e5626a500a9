"""A cell of two porous electrodes, each one spherical particle in an electrolyte: truth that no circuit is.

    v = U_p(y_s) + T-terms - U_n(x_s) + eta_p + eta_n + v_electrolyte + R_film i + lag

Diffusion in each particle follows Fick's law by eigenfunctions of the sphere (Crank, The Mathematics of Diffusion,
1975, eq. 6.45), with a diffusivity that depends on temperature and on how full the particle is. Kinetics are
Butler-Volmer with unequal transfer coefficients, solved by Newton's method, and an exchange current that falls towards
an empty and a full surface. The electrolyte's salt gradient follows the current by two modes and enters as a logarithm.
The negative electrode's curve lags behind the direction of charge: dz/ds = k (d - z)|d - z|, d = sign of the current,
over charge. One lumped temperature with irreversible and reversible heat.

Nothing here is shared with `simulators.cell`, with another truth, or with any model of the product.
"""

import math
from dataclasses import dataclass

import numpy as np

from simulators.cell import CellOutput

__all__ = ["Electrode", "ParticleCell", "ParticleParameters"]

_F_OVER_R = 11604.518  # K/V
_ZERO_K = 273.15
_REFERENCE_K = 298.15
# The first roots of tan x = x; faster modes have settled within a sample.
_ROOTS = np.array([4.493409, 7.725252, 10.904122, 14.066194, 17.220755, 20.371303, 23.519452, 26.666054])
_DECAYS, _SHARES = -(_ROOTS**2), 2.0 / _ROOTS**2
_MODES_SUM = float(_SHARES.sum())  # of the 1/5 of a steady gradient: the rest follows at once
_SALT = (0.8, 0.2)
_NEWTON, _SETTLED_V = 30, 1e-10
_LONGEST_STEP_S = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Electrode:
    """One electrode.

    Attributes
    ----------
    at_empty, at_full : stoichiometry of the empty and of the full cell
    curve : (voltage in V, centre, width) of each step of its potential
    base_V, slope_V : of the potential beside the steps
    diffusion_s : radius squared over diffusivity at 25 degC and half filling
    crowding : relative fall of the diffusivity from empty to full
    exchange_A : at 25 degC and half filling
    transfer : share of the overpotential that helps the charging direction
    kinetics_K, diffusion_K : activation temperatures
    entropy_V_per_K : slope of its potential with temperature, at half filling and its change over the filling
    """

    at_empty: float
    at_full: float
    curve: tuple[tuple[float, float, float], ...]
    base_V: float
    slope_V: float
    diffusion_s: float
    crowding: float
    exchange_A: float
    transfer: float
    kinetics_K: float
    diffusion_K: float
    entropy_V_per_K: tuple[float, float] = (0.0, 0.0)

    def potential_V(self, filling: float) -> float:
        """Potential over lithium at 25 degC."""
        filling = min(max(filling, 1e-4), 1.0 - 1e-4)
        out = self.base_V - self.slope_V * filling + 0.02569 * math.log((1.0 - filling) / filling)
        for height_V, centre, width in self.curve:
            out -= 0.5 * height_V * math.tanh((filling - centre) / width)
        return out

    def entropic_V(self, filling: float, warmer_K: float) -> float:
        """What its potential moves by with temperature."""
        middle, rise = self.entropy_V_per_K
        return warmer_K * (middle + rise * (filling - 0.5))


@dataclass(frozen=True, slots=True, kw_only=True)
class ParticleParameters:
    """Constants of a cell of two particles.

    Attributes
    ----------
    capacity_Ah : between the stoichiometries of the empty and the full cell
    negative, positive : electrodes
    film_Ohm, film_K : resistance of films and contacts inside, and its activation temperature
    film_on_charge : its share more on charge
    film_at_empty_Ohm : more of it near empty
    film_growth_per_Ah : relative growth with each ampere-hour
    series_Ohm : outside of the cell
    electrolyte_V, electrolyte_A : height of the logarithm, and the current at which the salt runs out
    electrolyte_s : time constants of the salt's two modes
    lag_V, lag_rate : height of the lag of the negative potential, and its rate over charge
    leakage_A : flows inside
    entropy_V_per_K : added to the open-circuit voltage's slope
    heat_J_per_K, cooling_W_per_K : lumped thermal model
    """

    capacity_Ah: float
    negative: Electrode
    positive: Electrode
    film_Ohm: float
    film_K: float
    electrolyte_V: float
    electrolyte_A: float
    electrolyte_s: tuple[float, float]
    lag_V: float
    lag_rate: float
    heat_J_per_K: float
    cooling_W_per_K: float
    film_on_charge: float = 0.0
    film_at_empty_Ohm: float = 0.0
    film_growth_per_Ah: float = 0.0
    series_Ohm: float = 0.0
    leakage_A: float = 0.0
    entropy_V_per_K: float = 0.0


class ParticleCell:
    """Such a cell with its state.

    Parameters
    ----------
    parameters : constants
    soc : state of charge at the start, at rest
    ambient_degC : the cell starts at it
    """

    def __init__(self, parameters: ParticleParameters, soc: float = 0.5, ambient_degC: float = 25.0) -> None:
        self.parameters = parameters
        self.ambient_degC = ambient_degC
        self._soc, self._kelvin = soc, ambient_degC + _ZERO_K
        self._modes = np.zeros((2, len(_ROOTS)))
        self._salt = [0.0, 0.0]
        self._lag, self._throughput_Ah, self._heat_J = 0.0, 0.0, 0.0

    def step(self, current_A: float, dt_s: float) -> CellOutput:
        """Hold a current (positive charges) for a time and return the truth at its end; 0 s only looks."""
        n = math.ceil(dt_s / _LONGEST_STEP_S)
        voltage, open_V = self._voltages(current_A) if n == 0 else (0.0, 0.0)
        for _ in range(n):
            voltage, open_V = self._advance(current_A, dt_s / n)
        lag_V = self.parameters.lag_V * self._lag
        return CellOutput(voltage, self._kelvin - _ZERO_K, self._soc, open_V, lag_V, self._heat_J)

    def _advance(self, current_A: float, dt_s: float) -> tuple[float, float]:
        """Move every state; terminal voltage and that of the same charge at rest, at the end."""
        p = self.parameters
        inner_A = current_A - p.leakage_A
        moved = inner_A * dt_s / (3600.0 * p.capacity_Ah)
        for number, electrode in enumerate((p.negative, p.positive)):
            decay = np.exp(_DECAYS * (dt_s / self._diffusion_s(electrode)))
            settled = _SHARES * self._drive(electrode, inner_A)
            self._modes[number] = settled + (self._modes[number] - settled) * decay
        for number, (share, tau_s) in enumerate(zip(_SALT, p.electrolyte_s, strict=True)):
            settled = share * inner_A / p.electrolyte_A
            self._salt[number] = settled + (self._salt[number] - settled) * math.exp(-dt_s / tau_s)
        if moved:
            gap = math.copysign(1.0, moved) - self._lag
            # The exact solution of dz/ds = k (d - z)|d - z|.
            self._lag += gap * (1.0 - 1.0 / (1.0 + p.lag_rate * abs(gap) * abs(moved)))
        self._soc += moved
        self._throughput_Ah += abs(current_A) * dt_s / 3600.0
        voltage, open_V = self._voltages(current_A)
        reversible_W = current_A * self._kelvin * self._slope_V_per_K()
        lost_W = current_A * (voltage - p.series_Ohm * current_A - open_V) + reversible_W + p.leakage_A * open_V
        settled_K = self.ambient_degC + _ZERO_K + lost_W / p.cooling_W_per_K
        self._kelvin = settled_K + (self._kelvin - settled_K) * math.exp(-p.cooling_W_per_K / p.heat_J_per_K * dt_s)
        self._heat_J += lost_W * dt_s
        return voltage, open_V

    def _filling(self, electrode: Electrode) -> float:
        return electrode.at_empty + self._soc * (electrode.at_full - electrode.at_empty)

    def _diffusion_s(self, electrode: Electrode) -> float:
        slower = math.exp(electrode.diffusion_K * (1.0 / self._kelvin - 1.0 / _REFERENCE_K))
        filling = min(max(self._filling(electrode), 0.0), 1.0)
        return electrode.diffusion_s * slower * math.exp(electrode.crowding * (filling - 0.5))

    def _drive(self, electrode: Electrode, current_A: float) -> float:
        """Surface less mean filling per unit of the steady gradient, times three."""
        rate = current_A / (3600.0 * self.parameters.capacity_Ah) * (electrode.at_full - electrode.at_empty)
        return rate * self._diffusion_s(electrode) / 3.0

    def _surface(self, number: int, electrode: Electrode, current_A: float) -> float:
        rest = (0.2 - _MODES_SUM) * self._drive(electrode, current_A)
        return min(max(self._filling(electrode) + float(self._modes[number].sum()) + rest, 1e-4), 1.0 - 1e-4)

    def _voltages(self, current_A: float) -> tuple[float, float]:
        """Terminal voltage and that of the same charge at rest."""
        p, warmer = self.parameters, self._kelvin - _REFERENCE_K
        inner_A = current_A - p.leakage_A
        voltage, open_V = 0.0, 0.0
        for number, (electrode, sign) in enumerate(((p.negative, -1.0), (p.positive, 1.0))):
            mean, surface = self._filling(electrode), self._surface(number, electrode, inner_A)
            voltage += sign * (electrode.potential_V(surface) + electrode.entropic_V(mean, warmer))
            open_V += sign * (electrode.potential_V(mean) + electrode.entropic_V(mean, warmer))
            voltage += self._overpotential_V(electrode, surface, inner_A)
        shared_V = p.lag_V * self._lag + p.entropy_V_per_K * warmer
        film = math.exp(p.film_K * (1.0 / self._kelvin - 1.0 / _REFERENCE_K))
        film *= 1.0 + p.film_growth_per_Ah * self._throughput_Ah + (p.film_on_charge if inner_A > 0.0 else 0.0)
        ohmic = film * (p.film_Ohm + p.film_at_empty_Ohm / (1.0 + math.exp((self._soc - 0.2) / 0.05)))
        salt = min(max(sum(self._salt), -0.9), 0.9)
        voltage += p.electrolyte_V * math.log((1.0 + salt) / (1.0 - salt)) + ohmic * inner_A + p.series_Ohm * current_A
        return voltage + shared_V, open_V + shared_V

    def _overpotential_V(self, electrode: Electrode, surface: float, current_A: float) -> float:
        """Butler-Volmer with unequal transfer coefficients: Newton's method on its logarithm-like inverse."""
        slower = math.exp(-electrode.kinetics_K * (1.0 / self._kelvin - 1.0 / _REFERENCE_K))
        ratio = current_A / (electrode.exchange_A * slower * 2.0 * math.sqrt(surface * (1.0 - surface)))
        f, a = _F_OVER_R / self._kelvin, electrode.transfer
        eta = math.asinh(0.5 * ratio) / (0.5 * f)
        for _ in range(_NEWTON):
            up, down = math.exp(a * f * eta), math.exp(-(1.0 - a) * f * eta)
            moved = (up - down - ratio) / (f * (a * up + (1.0 - a) * down))
            eta -= moved
            if abs(moved) < _SETTLED_V:
                break
        return eta

    def _slope_V_per_K(self) -> float:
        p = self.parameters
        own = p.positive.entropic_V(self._filling(p.positive), 1.0) - p.negative.entropic_V(
            self._filling(p.negative), 1.0
        )
        return own + p.entropy_V_per_K
