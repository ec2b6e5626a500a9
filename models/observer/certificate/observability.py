"""What the voltage tells of the state of charge, over the state of charge.

The rank of the observability matrix (eq. 2.31) is full on any curve that is not exactly flat. What counts is how large
the observability Gramian over a window is, and what the model's own error leaves of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.observer.filter.settings import ObserverSettings, default_settings
from models.readouts.ocv import ocv_table

# Slopes are taken over this much of the state of charge.
_STEP_SOC = 0.005
# Below this the voltage after an hour tells less than counting does: standard deviation of the SoC.
_BLIND_STD = 0.05
# Model errors up to this many standard deviations make the error ball; the curve is followed in such steps of SoC.
_BALL_SIGMA = 1.96
_CURVE_POINTS = 401


@dataclass(frozen=True)
class Observability:
    """Over the state of charge, all of shape (n,).

    Attributes
    ----------
    soc : fraction
    slope_V : slope of the open-circuit voltage per unit of SoC
    rank : of the observability matrix of the printed state; n + 1 is full
    gramian : diagonal element of the SoC in the windowed Gramian, V^2
    noise_std : SoC standard deviation from the window where noise were all there is, sqrt(R / W)
    soc_std : the same with the model's error, which no window averages out
    ball : how far off an estimate may settle while the model's error is within its 95 % band. The validity functions
        are taken at the estimate, so that it settles where the model's curve there meets the measured voltage: the
        ball reaches as far as the curve stays within the error
    """

    soc: FloatArray
    slope_V: FloatArray
    rank: np.ndarray
    gramian: FloatArray
    noise_std: FloatArray
    soc_std: FloatArray
    ball: FloatArray

    @property
    def blind(self) -> np.ndarray:
        """(n,) where charge has to be counted, for the voltage tells too little."""
        return self.soc_std > _BLIND_STD


def observability(
    network: LocalModelNetwork,
    soc: FloatArray,
    temperature_degC: float = 25.0,
    window_s: float = 600.0,
    settings: ObserverSettings | None = None,
) -> Observability:
    """Say what the voltage tells of the state of charge at rest.

    Parameters
    ----------
    network : the model
    soc : (n,) where to look
    temperature_degC : at which temperature
    window_s : how long the cell stays there
    settings : noise and model error; by default the model's own
    """
    assumed = settings or default_settings(network)
    near = np.clip(np.concatenate([soc - _STEP_SOC, soc + _STEP_SOC]), 0.0, 1.0)
    order_of = np.argsort(near, kind="stable")
    knots, inverse = np.unique(near[order_of], return_inverse=True)
    curve = ocv_table(network, knots, np.array([temperature_degC])).mean_V[0]
    volts = np.empty(len(near))
    volts[order_of] = curve[inverse]
    n = len(soc)
    slope = (volts[n:] - volts[:n]) / (near[n:] - near[:n])
    poles = _blended_poles(network, soc, temperature_degC)
    rank, gramian = np.empty(n, dtype=int), np.empty(n)
    for i in range(n):
        matrix = _state_matrix(poles[i], slope[i])
        rank[i] = np.linalg.matrix_rank(observability_matrix(matrix), tol=1e-9)
        gramian[i] = windowed_gramian(matrix, max(round(window_s / network.dt_s), 1))[-1, -1]
    noise_std = assumed.voltage_std_V / np.sqrt(np.maximum(gramian, 1e-300))
    error_V = np.hypot(assumed.slow_error_std_V, assumed.voltage_offset_std_V)
    of_error = error_V / np.maximum(np.abs(slope), 1e-12)
    grid = np.linspace(0.0, 1.0, _CURVE_POINTS)
    ball = error_ball(
        grid, ocv_table(network, grid, np.array([temperature_degC])).mean_V[0], soc, _BALL_SIGMA * error_V
    )
    return Observability(soc, slope, rank, gramian, noise_std, np.hypot(noise_std, of_error), ball)


def error_ball(grid: FloatArray, curve_V: FloatArray, soc: FloatArray, error_V: float) -> FloatArray:
    """How far a state of charge may be from another without a break whose voltage differs by no more than an error.

    Parameters
    ----------
    grid, curve_V : (m,) open-circuit curve, m at least 2
    soc : (n,) where to look
    error_V : of the voltage

    Returns
    -------
    (n,) distance, in fractions, to the farther end; at least half a step of the grid
    """
    ball = np.empty(len(soc))
    for i, (true_soc, true_V) in enumerate(zip(soc, np.interp(soc, grid, curve_V), strict=True)):
        outside = np.abs(curve_V - true_V) > error_V
        above, below = outside & (grid > true_soc), outside & (grid < true_soc)
        upper = grid[above][0] if above.any() else grid[-1]
        lower = grid[below][-1] if below.any() else grid[0]
        ball[i] = max(upper - true_soc, true_soc - lower)
    return np.maximum(ball, 0.5 * (grid[1] - grid[0]))


def observability_matrix(matrix: FloatArray) -> FloatArray:
    """C, CA, CA^2 ... below each other (eq. 2.31) with C = [1 0 ... 0]."""
    row, rows = np.eye(len(matrix))[0], []
    for _ in range(len(matrix)):
        rows.append(row)
        row = row @ matrix
    return np.array(rows)


def windowed_gramian(matrix: FloatArray, samples: int) -> FloatArray:
    """Sum of (C A^k)'(C A^k) over k = 1 ... samples with C = [1 0 ... 0]."""
    row, total = np.eye(len(matrix))[0], np.zeros(matrix.shape)
    for _ in range(samples):
        row = row @ matrix
        total += np.outer(row, row)
    return total


def _state_matrix(poles: FloatArray, slope_V: float) -> FloatArray:
    """Printed state matrix (eq. 2.36) in volts whose settled output follows the SoC with a slope."""
    n = max(len(poles), 1)
    matrix = np.zeros((n + 1, n + 1))
    matrix[0, : len(poles)] = poles
    matrix[0, n] = slope_V * (1.0 - poles.sum())
    for row in range(1, n):
        matrix[row, row - 1] = 1.0
    matrix[n, n] = 1.0
    return matrix


def _blended_poles(network: LocalModelNetwork, soc: FloatArray, temperature_degC: float) -> FloatArray:
    """(n, order) coefficients of the past outputs, blended where all other partition variables are in the middle."""
    structure = network.structure
    z = np.full((len(soc), len(structure.axes)), 0.5)
    for axis, channel in enumerate(structure.axes):
        low, high = network.scaling[channel.signal]
        if axis == structure.soc_axis:
            z[:, axis] = (soc - low) / (high - low)
        elif channel.signal == "temperature":
            z[:, axis] = (temperature_degC - low) / (high - low)
    return network.partition.validity(z) @ network.theta[:, : structure.output_order]
