"""The nearest parameters with which a network is a cell that can be: resistance positive, open-circuit curve rising.

A searched network has no bounds of its own. Where its read-outs are impossible, its parameters are moved as little as
can be: the distance counts in standard deviations, so that what the data determine hardly moves, and what they leave
open gives way. Conditions are linear in the parameters from step to step (their gradients are exact),
and each step is the least-distance problem of Lawson and Hanson, "Solving Least Squares Problems", 1974, ch. 23.4.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.readouts.ocv import DIRECTIONS
from models.readouts.steady_state import OperatingPoints, current_axis, settled_voltage, soc_axis, temperature_axis

# A resistance is at least this share of the median one.
_LEAST_SHARE = 0.02
# The curve rises by at least so much from point to point: more than rounding.
_LEAST_RISE_V = 1e-6
# Steps of the linearised problem, and conditions in each: those that are broken most, or nearest to it.
_STEPS, _CONDITIONS = 12, 300
# What a step is to leave over, as its conditions are not quite linear.
_SPARE = 1.2


def made_possible(network: LocalModelNetwork, theta_factor: FloatArray) -> LocalModelNetwork:
    """Move the parameters of a network to the nearest ones without impossible read-outs.

    Parameters
    ----------
    network : any structure
    theta_factor : (M p, P) factor F of the covariance F F' of its parameters in normalised units

    Returns
    -------
    LocalModelNetwork
        The same object where nothing was impossible, or where no parameters within reach mend it: what stays impossible
        is among the reservations of its tables. Points at which the network does not settle are left alone.
    """
    began, moved = network.theta.ravel(), network
    worst = np.inf
    for _ in range(_STEPS):
        value_V, least_V, gradient_V = _conditions(moved)
        short_V = _SPARE * least_V - value_V
        if not (value_V < least_V).any():
            return moved
        if not short_V.max() < worst:
            break
        chosen = np.argsort(-short_V)[:_CONDITIONS]
        rows = gradient_V[chosen]
        step = _nearest(rows @ theta_factor, short_V[chosen] + rows @ (moved.theta.ravel() - began))
        if step is None:
            break
        theta = (began + theta_factor @ step).reshape(network.theta.shape)
        worst, moved = float(short_V.max()), replace(network, theta=theta)
    return network


def _conditions(network: LocalModelNetwork) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(c,) values in V, what each is at least, and their (c, M p) gradients: overvoltages, then rises of the curve."""
    soc, degC, current_A = soc_axis(network), temperature_axis(network), current_axis(network)
    rested = settled_voltage(
        network, OperatingPoints.grid(soc, 0.0, np.array(DIRECTIONS)[:, None, None], degC[:, None])
    )
    shape = (len(DIRECTIONS), len(degC), len(soc))
    curve, curve_gradient = rested.voltage_V.reshape(shape), rested.gradient_V.reshape(*shape, -1)
    loaded = settled_voltage(
        network,
        OperatingPoints.grid(soc, current_A[:, None, None], np.sign(current_A)[:, None, None], degC[:, None]),
    )
    branch = (current_A > 0.0).astype(int)
    sign = np.sign(current_A)[:, None, None]
    over_V = sign * (loaded.voltage_V.reshape(-1, *shape[1:]) - curve[branch])
    over_gradient = sign[..., None] * (loaded.gradient_V.reshape(*over_V.shape, -1) - curve_gradient[branch])
    size = np.abs(current_A)[:, None, None]
    resistance = over_V / size
    settled = resistance[~np.isnan(resistance)]
    usual = float(np.median(np.abs(settled))) if settled.size else 0.0
    least = np.broadcast_to(_LEAST_SHARE * usual * size, over_V.shape)
    rise_V = np.diff(curve, axis=-1)
    value = np.concatenate([over_V.ravel(), rise_V.ravel()])
    at_least = np.concatenate([least.ravel(), np.full(rise_V.size, _LEAST_RISE_V)])
    n_parameters = network.theta.size
    gradient = np.concatenate(
        [over_gradient.reshape(-1, n_parameters), np.diff(curve_gradient, axis=2).reshape(-1, n_parameters)]
    )
    settles = ~np.isnan(value)
    return value[settles], at_least[settles], gradient[settles]


def _nearest(rows: FloatArray, least: FloatArray) -> FloatArray | None:
    """(P,) shortest vector z with rows z >= least; None where there is none."""
    scale = np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
    stacked = np.column_stack([rows / scale[:, None], least / scale]).T
    aim = np.zeros(len(stacked))
    aim[-1] = 1.0
    # Lazy: 0.5 s of processor time.
    from scipy.optimize import nnls

    try:
        weights, _ = nnls(stacked, aim, maxiter=30 * stacked.shape[1])
    except RuntimeError:
        return None
    left = stacked @ weights - aim
    return None if abs(left[-1]) < 1e-9 else -left[:-1] / left[-1]
