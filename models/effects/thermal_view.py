"""What an effect sees of a run's temperature: a lumped heat balance and the heat that drives it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals import KELVIN
from models.network.signals.filters import low_pass

# Readings at the start that are averaged: one alone would carry its noise through the whole run.
_START_SAMPLES = 30
# The skin's time constant, as a part of that of the cell.
_SOONER = 4.0


@dataclass(frozen=True)
class ThermalView:
    """One run with what warms and cools the cell.

    Attributes
    ----------
    heat_W : (n,) irreversible heat
    current_A, ambient_degC, temperature_degC : (n,) measured
    dt_s : sampling time
    resistance_K_per_W : of the model; temperature rise for each watt in the end
    time_constant_s : of the model
    dU_dT_V_per_K : entropic coefficient of the model
    offset_K : what the sensor reads too much in all runs
    quick_heat, quick_chamber : shares by which the skin follows the heat and the chamber sooner
    """

    heat_W: FloatArray
    current_A: FloatArray
    ambient_degC: FloatArray
    temperature_degC: FloatArray
    dt_s: float
    resistance_K_per_W: float
    time_constant_s: float
    dU_dT_V_per_K: float = 0.0
    offset_K: float = 0.0
    quick_heat: float = 0.0
    quick_chamber: float = 0.0

    @property
    def heat_capacity_J_per_K(self) -> float:
        """Heat capacity of the model."""
        return self.time_constant_s / self.resistance_K_per_W

    @property
    def reversible_W(self) -> FloatArray:
        """(n,) reversible heat for an entropic coefficient of 1 V/K."""
        return self.current_A * (self.temperature_degC + KELVIN)

    @property
    def initial_rise_K(self) -> float:
        """Measured rise above ambient at the start."""
        return float(np.median((self.temperature_degC - self.ambient_degC)[:_START_SAMPLES]))

    def simulated(self, initial_rise_K: float | None = None) -> FloatArray:
        """(n,) temperature in degC, from the measured rise above ambient at the start or another one."""
        began_K = self.initial_rise_K if initial_rise_K is None else initial_rise_K
        tau_s, resistance = self.time_constant_s, self.resistance_K_per_W
        heat, reversible, settled, quick_heat, quick_chamber = self.responses(tau_s).T
        rise = resistance * (heat + self.dU_dT_V_per_K * reversible + self.quick_heat * quick_heat)
        # The measured rise at the start has the offset already.
        skin = self.offset_K * settled + self.quick_chamber * quick_chamber
        return self._chamber(tau_s) + rise + began_K * (1.0 - settled) + skin

    def responses(self, time_constant_s: float) -> FloatArray:
        """(n, 5) K for 1 K/W of heat and of reversible heat, 1 K of offset, and of both skins that follow sooner."""
        soon_s = time_constant_s / _SOONER
        heat = low_pass(self.heat_W, time_constant_s, self.dt_s)
        return np.column_stack(
            [
                heat,
                low_pass(self.reversible_W, time_constant_s, self.dt_s),
                1.0 - np.exp(-np.arange(len(heat)) * self.dt_s / time_constant_s),
                low_pass(self.heat_W, soon_s, self.dt_s) - heat,
                self._chamber(soon_s) - self._chamber(time_constant_s),
            ]
        )

    def _chamber(self, time_constant_s: float) -> FloatArray:
        start = self.ambient_degC[0]
        return start + low_pass(self.ambient_degC - start, time_constant_s, self.dt_s)
