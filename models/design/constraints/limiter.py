"""The nearest current that keeps all limits, sample by sample, compiled.

Each wanted current is moved into what is allowed at its sample: bounds scaled by the state of charge, ramp, a state of
charge from which the rest of the experiment can still be done, and the predicted voltage.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from models.data.lookup import line
from models.network.compiled_network import FlatNetwork, step_output, step_signals

# To a millionth of the way: what is left of a current is checked with all limits.
_BISECTIONS = 20


class FlatLimits(NamedTuple):
    """Limits as plain arrays; charge counts in samples times ampere."""

    low_A: np.ndarray  # (N,) before the limitation ratio
    high_A: np.ndarray
    ratio_soc: np.ndarray
    discharge_ratio: np.ndarray
    charge_ratio: np.ndarray
    fall_A: float  # largest step down (positive number) and up from sample to sample
    rise_A: float
    soc_low: np.ndarray  # (N + 1,) from which the rest of the experiment can still be done
    soc_high: np.ndarray
    watch_voltage: bool
    y_low: np.ndarray  # (N,) normalised voltage, band taken off
    y_high: np.ndarray


@njit(cache=True)
def limit(
    net: FlatNetwork,
    limits: FlatLimits,
    wanted_A: np.ndarray,
    initial_soc: float,
    temperature_degC: float,
    lead: int,
    out: np.ndarray,
) -> None:
    """Write the limited current into `out`.

    Parameters
    ----------
    net : predicts the voltage
    limits : what holds
    wanted_A : (N,)
    initial_soc : at rest
    temperature_degC : of the cell
    lead : samples at rest before the first
    out : (N,) written
    """
    n_samples = wanted_A.shape[0]
    n_signals, depth = net.form.shape[0], 1 + max(net.tap_lag.max(), net.axis_lag.max())
    filters, trial = np.zeros((n_signals, 3)), np.zeros((n_signals, 3))
    history, weight = np.zeros((depth, n_signals)), np.zeros(net.theta.shape[0])
    y = np.empty((n_samples + lead, 1))
    direction, last_A, soc = -1.0, 0.0, initial_soc
    if limits.watch_voltage:
        for k in range(lead):
            for lag in range(depth - 1, 0, -1):
                history[lag] = history[lag - 1]
            step_signals(net, filters, history[0], 0.0, 0.0, soc, direction, temperature_degC)
            if k == 0:
                for lag in range(1, depth):
                    history[lag] = history[0]
            y[k, 0] = step_output(net, history, weight, y, k, np.nan)
    for k in range(n_samples):
        low, high = _allowed(net, limits, k, last_A, soc)
        current = min(max(float(wanted_A[k]), low), high)
        if limits.watch_voltage:
            for lag in range(depth - 1, 0, -1):
                history[lag] = history[lag - 1]
            at = k + lead
            calm = min(max(0.0, low), high)
            end = _try(net, filters, trial, history, weight, y, at, current, last_A, soc, direction, temperature_degC)
            if end > limits.y_high[k] or end < limits.y_low[k]:
                reached, inside = current, calm
                for _ in range(_BISECTIONS):
                    middle = 0.5 * (reached + inside)
                    end = _try(
                        net, filters, trial, history, weight, y, at, middle, last_A, soc, direction, temperature_degC
                    )
                    if end > limits.y_high[k] or end < limits.y_low[k]:
                        reached = middle
                    else:
                        inside = middle
                current = inside
            y[at, 0] = _try(
                net, filters, trial, history, weight, y, at, current, last_A, soc, direction, temperature_degC
            )
            filters[:, :] = trial
            direction = _turned(net, current, direction)
        soc += (net.efficiency if current > 0.0 else 1.0) * current * net.soc_per_A
        last_A = current
        out[k] = current


@njit(cache=True)
def _turned(net: FlatNetwork, current_A: float, direction: float) -> float:
    if current_A > net.rest_A:
        return 1.0
    return -1.0 if current_A < -net.rest_A else direction


# Arguments one by one, as its caller has them: each access to an array in a tuple counts a reference.
@njit(cache=True)
def _try(
    net: FlatNetwork,
    filters: np.ndarray,
    trial: np.ndarray,
    history: np.ndarray,
    weight: np.ndarray,
    y: np.ndarray,
    at: int,
    current_A: float,
    last_A: float,
    soc: float,
    direction: float,
    temperature_degC: float,
) -> float:
    """Normalised voltage that a current would lead to; leaves the filters moved on in `trial`."""
    trial[:, :] = filters
    end_soc = soc + (net.efficiency if current_A > 0.0 else 1.0) * current_A * net.soc_per_A
    turned = _turned(net, current_A, direction)
    step_signals(net, trial, history[0], current_A, current_A - last_A, end_soc, turned, temperature_degC)
    return step_output(net, history, weight, y, at, np.nan)


@njit(cache=True)
def _allowed(net: FlatNetwork, limits: FlatLimits, k: int, last_A: float, soc: float) -> tuple[float, float]:
    """Currents allowed at one sample by all limits but the voltage's."""
    discharge = line(limits.ratio_soc, limits.discharge_ratio, soc, False)
    charge = line(limits.ratio_soc, limits.charge_ratio, soc, False)
    low = limits.low_A[k] * (discharge if limits.low_A[k] < 0.0 else charge)
    high = limits.high_A[k] * (discharge if limits.high_A[k] < 0.0 else charge)
    # What the state of charge leaves, braking distance included; the bounds themselves come first.
    room_up = (limits.soc_high[k + 1] - soc) / (net.soc_per_A * net.efficiency)
    room_down = (soc - limits.soc_low[k + 1]) / net.soc_per_A
    if room_up < 0.0:
        room_up *= net.efficiency
    if room_down < 0.0:
        room_down /= net.efficiency
    ramp_low, ramp_high = last_A - limits.fall_A, last_A + limits.rise_A
    narrow_low = max(low, -_stoppable(room_down, limits.rise_A), ramp_low)
    narrow_high = min(high, _stoppable(room_up, limits.fall_A), ramp_high)
    if narrow_low <= narrow_high:
        return narrow_low, narrow_high
    # The ramp leaves no current that is allowed: the one nearest to it.
    nearest = min(max(ramp_low, min(narrow_high, high)), ramp_high) if narrow_low == ramp_low else narrow_high
    nearest = max(nearest, narrow_low) if narrow_high == ramp_high else nearest
    nearest = min(max(nearest, low), high)
    return nearest, nearest


@njit(cache=True)
def _stoppable(room: float, step_A: float) -> float:
    """Largest current that can be brought to rest, `step_A` a sample, before `room` is used up."""
    if room <= step_A:
        return room
    # I + (I - step) + (I - 2 step) + ... <= I^2 / (2 step) + I / 2 + step / 8 for every I.
    return max(step_A, step_A * (np.sqrt(0.25 + 2.0 * (room / step_A - 0.125)) - 0.5))
