"""Steady-state gains for a cell whose sensors and capacity are not known exactly.

The Riccati equation (eq. 2.46) is solved for noise alone: with a counter that never drifts its gain nearly forgets the
voltage, and an offset of the current sensor then carries the state of charge away. Q is the tuning parameter that the
method leaves open. Here its part for the state of charge is chosen, for each local model by itself, so that the error
of the state of charge is least with everything in it that a steady state can hold: noise, the model's error, and what
a current offset, a wrong capacity and a voltage offset of the declared sizes do for as long as the filter runs. Larger
gains cost noise, smaller ones let these through: one place between is best.
"""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.observer.filter.gains import observer_matrices, output_rows, steady_state_gains
from models.observer.filter.settings import ObserverSettings, error_levels
from models.readouts.resistance import resistance_table

# Current in multiples of 1C at which a wrong capacity and a wrong resistance are judged.
_TYPICAL_C = 0.5
_USUAL_DEGC, _MIDDLE_SOC = 25.0, 0.5
# Process noise of the state of charge that is tried, fraction per sqrt(s), from the settings' own on.
_LARGEST_Q, _TRIED = 1e-3, 13
# 2^40 samples: what has not died out by then never does.
_DOUBLINGS = 40


def designed_gains(
    network: LocalModelNetwork, settings: ObserverSettings, more_slow_V: FloatArray | float = 0.0
) -> FloatArray:
    """Steady-state gain of each local model with the process noise at which its error is least.

    Parameters
    ----------
    network : the model
    settings : noise, model error, and how far off sensors and capacity may be
    more_slow_V : (M,) see `gains.output_rows`

    Returns
    -------
    (M, s + 1) as `gains.steady_state_gains`; the variance of the SoC is that of the whole error.
    """
    matrices, process = observer_matrices(network, settings)
    rows = output_rows(network, settings, error_levels(network), np.hypot(more_slow_V, _resistive_V(network, settings)))
    measurement = (settings.voltage_std_V / network.voltage_span_V) ** 2
    at_soc = matrices.shape[1] - 3
    low = max(settings.soc_std_per_sqrt_s, 1e-8)
    best = np.zeros((len(matrices), matrices.shape[1] + 1))
    least = np.full(len(matrices), np.inf)
    for std in np.geomspace(low, max(_LARGEST_Q, low), _TRIED):
        assumed = process.copy()
        assumed[at_soc, at_soc] = std**2 * network.dt_s
        gains = steady_state_gains(matrices, rows, assumed, measurement)
        for i, (matrix, row, gain) in enumerate(zip(matrices, rows, gains[:, :-1], strict=True)):
            variance = _soc_variance(network, settings, matrix, row, gain, process)
            if variance < least[i]:
                least[i], best[i] = variance, [*gain, variance]
    return best


def _soc_variance(
    network: LocalModelNetwork,
    settings: ObserverSettings,
    matrix: FloatArray,
    row: FloatArray,
    gain: FloatArray,
    process: FloatArray,
) -> float:
    """Variance of the SoC's error in the steady state of a filter with this gain; infinite where there is none."""
    left = np.eye(len(row)) - np.outer(gain, row)
    closed = left @ matrix
    if gain[len(row) - 3] == 0.0 or np.abs(np.linalg.eigvals(closed)).max() >= 1.0:
        return np.inf
    measurement = (settings.voltage_std_V / network.voltage_span_V) ** 2
    driven = left @ process @ left.T + measurement * np.outer(gain, gain)
    noise = _settled(closed, driven)
    lasting = np.linalg.solve(np.eye(len(row)) - closed, _each_sample(network, settings, left, gain).T)
    at_soc = len(row) - 3
    return float(noise[at_soc, at_soc] + np.sum(lasting[at_soc] ** 2))


def _settled(closed: FloatArray, driven: FloatArray) -> FloatArray:
    """(s, s) covariance P = F P F' + D of a stable F, by doubling: near the unit circle solvers lose it in rounding."""
    covariance, power = driven.copy(), closed.copy()
    for _ in range(_DOUBLINGS):
        covariance = covariance + power @ covariance @ power.T
        power = power @ power
    return covariance


def _each_sample(
    network: LocalModelNetwork, settings: ObserverSettings, left: FloatArray, gain: FloatArray
) -> FloatArray:
    """(3, s) what one standard deviation of current offset, capacity and voltage offset adds to the error a sample."""
    at_soc, hours = len(gain) - 3, network.dt_s / 3600.0
    return np.array(
        [
            left[:, at_soc] * hours * settings.current_offset_std_C,
            left[:, at_soc] * hours * _TYPICAL_C * settings.capacity_std,
            gain * settings.voltage_offset_std_V / network.voltage_span_V,
        ]
    )


def _resistive_V(network: LocalModelNetwork, settings: ObserverSettings) -> float:
    """Standard deviation of what wrong resistances do to the voltage at a typical current."""
    current_A = _TYPICAL_C * network.cell.capacity_Ah
    own_V = 0.0
    if settings.resistance_std > 0.0:
        read = resistance_table(network, _MIDDLE_SOC, -current_A, _USUAL_DEGC).resistance_Ohm[0, 0, 0]
        own_V = settings.resistance_std * current_A * abs(float(np.nan_to_num(read)))
    return float(np.hypot(own_V, settings.series_resistance_std_Ohm * current_A))
