"""How resistances scale with temperature, and the zero of the Kelvin scale.

Compiled functions (njit) take the constants in as they are.
"""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray

KELVIN = 273.15
REFERENCE_K = 298.15


def arrhenius(temperature_degC: FloatArray, activation_K: float) -> FloatArray:
    """exp(activation (1/T - 1/298.15 K)): how much larger a resistance is than at 25 degC."""
    return np.exp(activation_K * (1.0 / (temperature_degC + KELVIN) - 1.0 / REFERENCE_K))
