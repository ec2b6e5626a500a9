"""How resistances scale with temperature, how far a curve goes on with it, and the zero of the Kelvin scale.

Compiled functions (njit) take the constants in as they are.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.data.timeseries import FloatArray
from models.network.signals.loop_form import INVERSE_TEMPERATURE, TEMPERATURE

KELVIN = 273.15
# The range of temperature from which on its influence can be told.
MOVING_K = 2.0
REFERENCE_K = 298.15
# What a curve does with temperature it does beyond the temperatures of its runs for so many kelvin more and no further,
# ever less. Where a curve is steep its change holds what hides there as well, 5 mV/K and more, which no cell has 20 K
# on. Of nine splits of measured records by temperature 6 K left A123 64 to 46 and 154 to 148 mV, warm Panasonic cycles
# up to 2 mV less, cold ones the same (3 worse to 4 better), and a Leaf cell 5.6 to 7.8; 3 and 10 K were like it.
FURTHEST_K = 6.0


def arrhenius(temperature_degC: FloatArray, activation_K: float) -> FloatArray:
    """exp(activation (1/T - 1/298.15 K)): how much larger a resistance is than at 25 degC."""
    return np.exp(activation_K * (1.0 / (temperature_degC + KELVIN) - 1.0 / REFERENCE_K))


@njit(cache=True)
def within_degC(temperature_degC: float, low_degC: float, high_degC: float) -> float:
    """Return a temperature, beyond a range ever less of what is beyond: `FURTHEST_K` at the most."""
    if temperature_degC > high_degC:
        return float(high_degC - FURTHEST_K * np.expm1((high_degC - temperature_degC) / FURTHEST_K))
    if temperature_degC < low_degC:
        return float(low_degC + FURTHEST_K * np.expm1((temperature_degC - low_degC) / FURTHEST_K))
    return temperature_degC


@njit(cache=True)
def inside_trained(form: int, z: float) -> float:
    """Return a normalised partition variable; a temperature is held at the edges of the trained range.

    What a local model says it says in the blends that were trained. Far outside of the temperatures of its runs the
    nearest kernels would take all, however little each of them had to say by itself: a measured cell's network of runs
    at 25 and 45 degC was 76 mV off at 5 degC and is 23, one of 5 and 25 degC 320 mV at 45 and is 17, each with a run at
    25. A state of charge goes on.
    """
    return min(max(z, 0.0), 1.0) if form == TEMPERATURE or form == INVERSE_TEMPERATURE else z
