"""What an effect sees of a run's temperature: a lumped heat balance and the heat that drives it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals import KELVIN
from models.network.signals.filters import low_pass

# Readings at the start that are averaged: one alone would carry its noise through the whole run.
_START_SAMPLES = 30


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
    """

    heat_W: FloatArray
    current_A: FloatArray
    ambient_degC: FloatArray
    temperature_degC: FloatArray
    dt_s: float
    resistance_K_per_W: float
    time_constant_s: float
    dU_dT_V_per_K: float = 0.0

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
        tau_s = self.time_constant_s
        heat_W = self.heat_W + self.dU_dT_V_per_K * self.reversible_W
        start = self.ambient_degC[0]
        chamber = start + low_pass(self.ambient_degC - start, tau_s, self.dt_s)
        decay = np.exp(-np.arange(len(heat_W)) * self.dt_s / tau_s)
        rise = self.resistance_K_per_W * low_pass(heat_W, tau_s, self.dt_s)
        return chamber + rise + began_K * decay
