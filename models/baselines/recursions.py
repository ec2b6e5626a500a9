"""First-order states of a circuit: the current through a resistor beside a capacitor, and hysteresis.

Both obey x(k) = p(k) x(k-1) + (1 - p(k)) u(k) with p(k) = exp(-step(k) exp(theta(T(k)))), the exact solution for a
current that is held over each interval. A branch has u = current, step = the sampling time and theta = -log(time
constant); hysteresis (Plett, Battery Management Systems I, 2015, ch. 2) has u = the current's direction, step = the
charge moved over the capacity and theta = log(gamma). theta is piecewise linear over temperature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from models.baselines.tables import Axis
from models.data.timeseries import FloatArray
from models.network import signals


@dataclass(frozen=True)
class Drive:
    """What moves a state.

    Attributes
    ----------
    u : (N,) where the state tends to
    step : (N,) how far the interval takes it, times the rate
    starts : indices at which it begins anew, at zero
    """

    u: FloatArray
    step: FloatArray
    starts: np.ndarray


def branch_drive(current_A: FloatArray, dt_s: float, starts: np.ndarray) -> Drive:
    """Drive of a resistor beside a capacitor; its state is the resistor's current in A, its rate 1 / time constant."""
    return Drive(current_A, np.full(len(current_A), dt_s), starts)


def hysteresis_drive(
    current_A: FloatArray, dt_s: float, capacity_Ah: float, rest_A: float, starts: np.ndarray
) -> Drive:
    """Drive of the one-state hysteresis; its state lies in -1..1, its rate is gamma."""
    return Drive(direction(current_A, rest_A, starts), np.abs(current_A) * dt_s / (3600.0 * capacity_Ah), starts)


def direction(current_A: FloatArray, rest_A: float, starts: np.ndarray) -> FloatArray:
    """Direction of the last current, -1 or 1; 0 before the first one of each part."""
    ends = [*starts[1:], len(current_A)]
    parts = [signals.held_sign(current_A[a:b], rest_A, initial=0.0) for a, b in zip(starts, ends, strict=True)]
    return np.concatenate(parts)


def state(drive: Drive, theta: FloatArray, temperature: Axis) -> FloatArray:
    """(N,) state for log rates `theta` at the temperature knots."""
    return _state(drive.u, drive.step, drive.starts, np.exp(theta), theta, temperature.cell, temperature.fraction)


def log_rate_gradient(
    drive: Drive, theta: FloatArray, temperature: Axis, x: FloatArray, weight: FloatArray
) -> FloatArray:
    """(T,) derivative of sum(weight x) with respect to `theta`, by the adjoint recursion.

    Parameters
    ----------
    x : (N,) the state itself
    weight : (N,) what one unit of the state adds at each sample
    """
    return _gradient(drive.u, drive.step, drive.starts, theta, temperature.cell, temperature.fraction, x, weight)


@njit(cache=True)
def _log_rate(theta: np.ndarray, cell: int, fraction: float) -> float:
    if fraction == 0.0:
        return theta[cell]
    return (1.0 - fraction) * theta[cell] + fraction * theta[cell + 1]


@njit(cache=True)
def _state(
    u: np.ndarray,
    step: np.ndarray,
    starts: np.ndarray,
    rate: np.ndarray,
    theta: np.ndarray,
    cell: np.ndarray,
    fraction: np.ndarray,
) -> np.ndarray:
    out = np.empty(len(u))
    single = len(theta) == 1
    part, x = 0, 0.0
    for k in range(len(u)):
        if part < len(starts) and k == starts[part]:
            x, part = 0.0, part + 1
        else:
            speed = rate[0] if single else np.exp(_log_rate(theta, cell[k], fraction[k]))
            pole = np.exp(-step[k] * speed)
            x = pole * x + (1.0 - pole) * u[k]
        out[k] = x
    return out


@njit(cache=True)
def _gradient(
    u: np.ndarray,
    step: np.ndarray,
    starts: np.ndarray,
    theta: np.ndarray,
    cell: np.ndarray,
    fraction: np.ndarray,
    x: np.ndarray,
    weight: np.ndarray,
) -> np.ndarray:
    out = np.zeros(len(theta))
    part, adjoint = len(starts) - 1, 0.0
    for k in range(len(u) - 1, -1, -1):
        adjoint += weight[k]
        if part >= 0 and k == starts[part]:
            adjoint, part = 0.0, part - 1
            continue
        speed = np.exp(_log_rate(theta, cell[k], fraction[k]))
        pole = np.exp(-step[k] * speed)
        # d pole / d theta = -pole step exp(theta)
        share = adjoint * -pole * step[k] * speed * (x[k - 1] - u[k])
        out[cell[k]] += (1.0 - fraction[k]) * share
        if fraction[k] > 0.0:
            out[cell[k] + 1] += fraction[k] * share
        adjoint *= pole
    return out
