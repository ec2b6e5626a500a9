"""What a simulated cell settles to: the truth that a model's read-outs are held against.

The closed form of `simulators.cell` where state of charge, temperature and current are held: every first-order state
has reached its end, and hysteresis lies fully on the side of the last direction.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulators.cell import REFERENCE_K, SOC_SCALE, ZERO_DEGC_K
from simulators.cell_parameters import CellParameters

__all__ = ["open_circuit_V", "settled_resistance_Ohm", "step_resistance_Ohm"]

Values = NDArray[np.float64]


def open_circuit_V(p: CellParameters, soc: ArrayLike, temperature_degC: ArrayLike, direction: ArrayLike) -> Values:
    """Voltage at rest; `direction` is +1 after charge, -1 after discharge, 0 for the mean of both."""
    soc, degC, side = (np.asarray(value, dtype=np.float64) for value in (soc, temperature_degC, direction))
    curve = np.vectorize(p.open_circuit.voltage_V, otypes=[np.float64])(soc)
    return curve + p.dU_dT_V_per_K * (degC + ZERO_DEGC_K - REFERENCE_K) + p.hysteresis_amplitude_V * side


def settled_resistance_Ohm(
    p: CellParameters, soc: ArrayLike, current_A: ArrayLike, temperature_degC: ArrayLike
) -> Values:
    """(V(I) - V(0)) / I long after a step, hysteresis on the current's side before it already."""
    pairs = p.fast_1.resistance_Ohm + p.fast_2.resistance_Ohm + p.slow.resistance_Ohm
    current, factor = _factor(p, current_A, temperature_degC)
    return _instant_Ohm(p, soc, current, factor) + factor * pairs


def step_resistance_Ohm(
    p: CellParameters, soc: float, current_A: float, temperature_degC: float, time_s: ArrayLike
) -> Values:
    """The same a time after the step from rest."""
    current, factor = _factor(p, current_A, temperature_degC)
    out = _instant_Ohm(p, soc, current, factor)
    for branch in (p.fast_1, p.fast_2, p.slow):
        out = out - factor * branch.resistance_Ohm * np.expm1(-np.asarray(time_s, float) / branch.time_constant_s)
    return out


def _factor(p: CellParameters, current_A: ArrayLike, temperature_degC: ArrayLike) -> tuple[Values, Values]:
    current, degC = np.asarray(current_A, dtype=np.float64), np.asarray(temperature_degC, dtype=np.float64)
    warm = np.exp(p.activation_K * (1.0 / (degC + ZERO_DEGC_K) - 1.0 / REFERENCE_K))
    return current, warm * np.where(current > 0.0, p.charge_resistance_ratio, 1.0)


def _instant_Ohm(p: CellParameters, soc: ArrayLike, current: Values, factor: Values) -> Values:
    ohmic = p.ohmic_Ohm + p.ohmic_at_empty_Ohm * np.exp(-np.maximum(np.asarray(soc, float), 0.0) / SOC_SCALE)
    transfer = p.charge_transfer_V * np.arcsinh(current * factor / (2.0 * p.exchange_current_A)) / current
    return ohmic * factor + transfer + p.series_resistance_Ohm
