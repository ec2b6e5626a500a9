"""From a current to the signals of a network and back: values forwards, derivatives backwards, compiled.

The held direction of the current has no derivative: its sequence is taken as it is. Temperature is given, not a
consequence of the current.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.network.compiled_network import FlatNetwork, bent
from models.network.signals.filters import DIFFUSION_GAINS, EMPTY_SOC, FURTHEST_BEHIND, slower_at
from models.network.signals.loop_form import (
    AS_IS,
    CASCADE,
    CHARGE,
    DIFFUSION,
    DIRECTION,
    DISCHARGE,
    DRIVEN,
    ENTRY_BITS,
    LOOP,
    MAGNITUDE,
    SIGNED_SQUARE,
    SOC,
    SQUARED_BIT,
    TEMPERATURE,
)
from models.network.signals.temperature_scale import KELVIN, REFERENCE_K, within_degC


@njit(cache=True)
def signal_values(
    net: FlatNetwork,
    current_A: np.ndarray,
    initial_soc: float,
    temperature_degC: np.ndarray,
    values: np.ndarray,
    slopes: np.ndarray,
    soc: np.ndarray,
) -> None:
    """Signals over a whole run, as `models.network.signals` has them.

    Parameters
    ----------
    net : the network
    current_A : (N,) current_A[k] flows from sample k-1 to sample k
    initial_soc : fraction
    temperature_degC : (N,)
    values : (N, S) normalised signals, written
    slopes : (N, S) derivative of what enters the signal's filter to the current of the same sample, written
    soc : (N,) written
    """
    n_samples = current_A.shape[0]
    charge = initial_soc
    for k in range(n_samples):
        if k > 0:
            current = float(current_A[k])
            charge += (net.efficiency if current > 0.0 else 1.0) * current * net.soc_per_A
        soc[k] = charge
    for s in range(net.form.shape[0]):
        form = net.form[s]
        if form >= DRIVEN:
            _driven(net, s, current_A, temperature_degC, values, slopes)
        elif form == SOC or form == DIFFUSION:
            _diffusion(net, s, current_A, temperature_degC, soc, values, slopes)
        elif form == CASCADE:
            _cascade(net, s, current_A, values)
        elif form == LOOP:
            _loop(net, s, current_A, values, slopes)
        elif form == DIRECTION:
            direction = -1.0
            for k in range(n_samples):
                if current_A[k] > net.rest_A:
                    direction = 1.0
                elif current_A[k] < -net.rest_A:
                    direction = -1.0
                values[k, s] = direction
        else:
            for k in range(n_samples):
                inside = within_degC(temperature_degC[k], net.pole[s, 0], net.pole[s, 1])
                values[k, s] = inside if form == TEMPERATURE else 1.0 / (temperature_degC[k] + KELVIN)
        for k in range(n_samples):
            if form == SOC:
                values[k, s] = soc[k] + net.factor[s] * values[k, s]
            elif form == DIFFUSION:
                values[k, s] = min(max(net.factor[s] * values[k, s], -FURTHEST_BEHIND), FURTHEST_BEHIND)
            values[k, s] = (values[k, s] - net.low[s]) / net.span[s]


@njit(cache=True)
def _driven(
    net: FlatNetwork,
    s: int,
    current_A: np.ndarray,
    temperature_degC: np.ndarray,
    values: np.ndarray,
    slopes: np.ndarray,
) -> None:
    """Current, scaled by temperature, through asinh and bent where asked, then low-passed."""
    pole, entry, state = net.pole[s, 0], net.form[s] & ENTRY_BITS, 0.0
    for k in range(current_A.shape[0]):
        slope = _slowed(net, s, temperature_degC[k])
        value = slope * current_A[k]
        if net.exchange_A[s] != 0.0:
            value /= net.exchange_A[s]
            slope /= net.exchange_A[s] * np.sqrt(1.0 + value * value)
            value = np.arcsinh(value)
        if entry != AS_IS:
            slope *= _bent_slope(entry, value)
            value = bent(entry, value)
        state = pole * state + (1.0 - pole) * value
        values[k, s], slopes[k, s] = state, slope
        if net.form[s] & SQUARED_BIT:
            values[k, s] = state * abs(state)


@njit(cache=True)
def _bent_slope(entry: int, x: float) -> float:
    """Slope of `bent`; 0 where it has a corner."""
    if entry == CHARGE:
        return 1.0 if x > 0.0 else 0.0
    if entry == DISCHARGE:
        return 1.0 if x < 0.0 else 0.0
    if entry == MAGNITUDE:
        return float(np.sign(x))
    return 2.0 * abs(x) if entry == SIGNED_SQUARE else 2.0 * x


@njit(cache=True)
def _slowed(net: FlatNetwork, s: int, temperature_degC: float) -> float:
    if net.activation_K[s] == 0.0:
        return 1.0
    return float(np.exp(net.activation_K[s] * (1.0 / (temperature_degC + KELVIN) - 1.0 / REFERENCE_K)))


@njit(cache=True)
def _diffusion(
    net: FlatNetwork,
    s: int,
    current_A: np.ndarray,
    temperature_degC: np.ndarray,
    soc: np.ndarray,
    values: np.ndarray,
    slopes: np.ndarray,
) -> None:
    """Shift of the surface's state of charge, in A; the slopes hold by how much diffusion is slowed."""
    for k in range(current_A.shape[0]):
        values[k, s], slopes[k, s] = 0.0, 1.0
    if net.factor[s] == 0.0:
        return
    for mode in range(3):
        state = 0.0
        for k in range(current_A.shape[0]):
            slowed = _slowed(net, s, temperature_degC[k])
            if net.exchange_A[s] != 0.0:
                slowed *= slower_at(net.exchange_A[s], soc[k])
            keep = np.exp(-net.pole[s, mode] / slowed)
            state = keep * state + (1.0 - keep) * DIFFUSION_GAINS[mode] * slowed * current_A[k]
            values[k, s] += state
            slopes[k, s] = slowed


@njit(cache=True)
def _cascade(net: FlatNetwork, s: int, current_A: np.ndarray, values: np.ndarray) -> None:
    """Third-order low-pass of the current's change."""
    first, second, third = 0.0, 0.0, 0.0
    a, b, c = net.pole[s, 0], net.pole[s, 1], net.pole[s, 2]
    for k in range(current_A.shape[0]):
        change = current_A[k] - current_A[k - 1] if k > 0 else 0.0
        first = a * first + (1.0 - a) * change
        second = b * second + (1.0 - b) * first
        third = c * third + (1.0 - c) * second
        values[k, s] = third / (1.0 - a)


@njit(cache=True)
def _loop(net: FlatNetwork, s: int, current_A: np.ndarray, values: np.ndarray, slopes: np.ndarray) -> None:
    """One-state hysteresis; the slope holds how the state moves with the present current."""
    state = 0.0
    for k in range(current_A.shape[0]):
        sign = np.sign(current_A[k])
        keep = np.exp(-net.factor[s] * abs(current_A[k]))
        slopes[k, s] = -net.factor[s] * sign * keep * (state - sign)
        state = keep * state + (1.0 - keep) * sign
        values[k, s] = state


@njit(cache=True)
def current_gradient(
    net: FlatNetwork,
    current_A: np.ndarray,
    soc: np.ndarray,
    signals: np.ndarray,
    slopes: np.ndarray,
    by_signal: np.ndarray,
    out: np.ndarray,
) -> None:
    """Carry derivatives to the normalised signals back to the current.

    Parameters
    ----------
    net, current_A, soc, signals, slopes : as `signal_values` left them
    by_signal : (N, S) derivatives to the normalised signals
    out : (N,) derivative to each current, written
    """
    n_samples = current_A.shape[0]
    out[:] = 0.0
    by_soc = np.zeros(n_samples)
    for s in range(net.form.shape[0]):
        form = net.form[s]
        if form == SOC:
            for k in range(n_samples):
                by_soc[k] += by_signal[k, s] / net.span[s]
        elif form == DIFFUSION:
            for k in range(n_samples):  # where it is as far behind as can be it does not move
                if abs(net.low[s] + net.span[s] * signals[k, s]) > (1.0 - 1e-9) * FURTHEST_BEHIND:
                    by_signal[k, s] = 0.0
        if form == SOC or form == DIFFUSION:
            if net.factor[s] != 0.0:
                _diffusion_gradient(net, s, slopes, by_signal, out)
                if net.exchange_A[s] != 0.0:
                    _emptying_gradient(net, s, current_A, soc, slopes, by_signal, by_soc)
        elif form >= DRIVEN and not form & SQUARED_BIT:
            pole, total = net.pole[s, 0], 0.0
            for k in range(n_samples - 1, -1, -1):
                total = pole * total + by_signal[k, s] / net.span[s]
                out[k] += (1.0 - pole) * total * slopes[k, s]
        elif form >= DRIVEN:
            pole, total = net.pole[s, 0], 0.0
            for k in range(n_samples - 1, -1, -1):
                root = np.sqrt(abs(net.low[s] + net.span[s] * signals[k, s]))
                total = pole * total + 2.0 * root * by_signal[k, s] / net.span[s]
                out[k] += (1.0 - pole) * total * slopes[k, s]
        elif form == CASCADE:
            _cascade_gradient(net, s, by_signal, out)
        elif form == LOOP:
            total = 0.0
            for k in range(n_samples - 1, -1, -1):
                total += by_signal[k, s] / net.span[s]
                out[k] += total * slopes[k, s]
                total *= np.exp(-net.factor[s] * abs(current_A[k]))
    total = 0.0
    for k in range(n_samples - 1, 0, -1):
        total += by_soc[k]
        out[k] += (net.efficiency if current_A[k] > 0.0 else 1.0) * net.soc_per_A * total


@njit(cache=True)
def _cascade_gradient(net: FlatNetwork, s: int, by_signal: np.ndarray, out: np.ndarray) -> None:
    first, second, third = 0.0, 0.0, 0.0
    a, b, c = net.pole[s, 0], net.pole[s, 1], net.pole[s, 2]
    scale = 1.0 / ((1.0 - a) * net.span[s])
    for k in range(by_signal.shape[0] - 1, 0, -1):
        third = c * third + scale * by_signal[k, s]
        second = b * second + (1.0 - c) * third
        first = a * first + (1.0 - b) * second
        out[k] += (1.0 - a) * first
        out[k - 1] -= (1.0 - a) * first


@njit(cache=True)
def _diffusion_gradient(net: FlatNetwork, s: int, slopes: np.ndarray, by_signal: np.ndarray, out: np.ndarray) -> None:
    scale = net.factor[s] / net.span[s]
    for mode in range(3):
        total = 0.0
        for k in range(by_signal.shape[0] - 1, -1, -1):
            keep = np.exp(-net.pole[s, mode] / slopes[k, s])
            total += scale * by_signal[k, s]
            out[k] += (1.0 - keep) * DIFFUSION_GAINS[mode] * slopes[k, s] * total
            total *= keep


@njit(cache=True)
def _emptying_gradient(
    net: FlatNetwork,
    s: int,
    current_A: np.ndarray,
    soc: np.ndarray,
    slopes: np.ndarray,
    by_signal: np.ndarray,
    by_soc: np.ndarray,
) -> None:
    """What a diffusion that slows down towards empty passes on to the state of charge."""
    n_samples, scale = current_A.shape[0], net.factor[s] / net.span[s]
    moved = np.empty(n_samples)
    for mode in range(3):
        rate, gain, state = net.pole[s, mode], DIFFUSION_GAINS[mode], 0.0
        for k in range(n_samples):
            keep, settled = np.exp(-rate / slopes[k, s]), gain * slopes[k, s] * current_A[k]
            moved[k] = keep * rate / slopes[k, s] ** 2 * (state - settled) + (1.0 - keep) * gain * current_A[k]
            state = keep * state + (1.0 - keep) * settled
        total = 0.0
        for k in range(n_samples - 1, -1, -1):
            total += scale * by_signal[k, s]
            if soc[k] > 0.0:
                more = slower_at(net.exchange_A[s], soc[k])
                by_soc[k] -= total * moved[k] * slopes[k, s] * (more - 1.0) / (more * EMPTY_SOC)
            total *= np.exp(-rate / slopes[k, s])
