"""One sample of the observer as a compiled function of plain arrays; live and replay both call it."""

from __future__ import annotations

import numpy as np
from numba import njit

from models.signals import DIFFUSION_GAINS

# Kinds of signals, as codes for the compiled step.
SOC, FILTERED, CHARGE_TRANSFER, RELAXATION, HYSTERESIS, HYSTERESIS_STATE, TEMPERATURE, INVERSE_TEMPERATURE = range(8)
SQUARED = 8
CODES = {
    "soc": SOC,
    "surface_soc": SOC,
    "current": FILTERED,
    "low_pass": FILTERED,
    "scaled_current": FILTERED,
    "charge_transfer": CHARGE_TRANSFER,
    "squared_current": SQUARED,
    "relaxation": RELAXATION,
    "hysteresis": HYSTERESIS,
    "hysteresis_state": HYSTERESIS_STATE,
    "temperature": TEMPERATURE,
    "inverse_temperature": INVERSE_TEMPERATURE,
}
# Columns of the signals' constants: poles of three filter stages (of a state of charge: rates of the three modes of
# diffusion per sample at 25 degC), gain, activation in K, exchange current in A, rate per A and sample, then low end
# and span of the normalisation.
POLE, GAIN, ACTIVATION, EXCHANGE, RATE, LOW, SPAN = 0, 3, 4, 5, 6, 7, 8
N_CONSTANTS = 9
# Columns of the output row.
SOC_OUT, SOC_STD_OUT, VOLTAGE_OUT, INNOVATION_OUT, INNOVATION_STD_OUT = range(5)
N_OUT = 5
# How far the estimate may leave 0..1.
SOC_SLACK = 0.05
# The steady-state gains take over once the SoC's variance is within this factor of theirs.
START_UP_RATIO = 1.5


@njit(cache=True)
def step(
    # what the network is
    theta: np.ndarray,
    centres: np.ndarray,
    inverse_widths: np.ndarray,
    gains: np.ndarray,
    order: int,
    kind: np.ndarray,
    signal: np.ndarray,
    tap_signal: np.ndarray,
    tap_lag: np.ndarray,
    axis_signal: np.ndarray,
    axis_lag: np.ndarray,
    constants: np.ndarray,
    # memory, updated in place
    x: np.ndarray,
    covariance: np.ndarray,
    filters: np.ndarray,
    history: np.ndarray,
    held: np.ndarray,
    # the sample
    current_A: float,
    voltage: float,
    temperature_degC: float,
    out: np.ndarray,
) -> None:
    """Advance by one sample.

    Parameters
    ----------
    theta, centres, inverse_widths : (M, ...) parameters, kernel centres and inverse widths
    gains : (M, s + 1) gains K_i and, last, the steady-state variance of the SoC
    kind, signal : per signal: code; constants in the columns named above
    tap_signal, tap_lag : per input tap: which signal, how many samples back
    axis_signal, axis_lag : per partition axis: the same
    constants : [SoC per A and sample, q_output, q_soc, R, rest_A]
    x : (s,) [y(k) ... normalised, SoC(k) as a fraction]; covariance : (s, s)
    filters : (signals, 3); history : (lags, signals) normalised values of past samples, newest first
    held : [last current, held direction, last temperature, samples seen]
    current_A, voltage (normalised, NaN = missing), temperature_degC
    out : (N_OUT,) written: SoC and its variance; output, innovation and its variance, normalised
    """
    n_signals = kind.shape[0]
    n_models, n_params = theta.shape
    n_axes = centres.shape[1]
    size = x.shape[0]
    if np.isnan(temperature_degC):
        temperature_degC = held[2]
    if np.isnan(current_A):
        current_A = held[0]
    first = held[3] == 0.0
    if first:
        held[0] = current_A
    change = current_A - held[0]
    if current_A > constants[4]:
        held[1] = 1.0
    elif current_A < -constants[4]:
        held[1] = -1.0
    now = np.empty(n_signals)
    for s in range(n_signals):
        slowed = 1.0
        if signal[s, ACTIVATION] != 0.0:
            slowed = np.exp(signal[s, ACTIVATION] * (1.0 / (temperature_degC + 273.15) - 1.0 / 298.15))
        base = current_A * slowed
        if kind[s] == CHARGE_TRANSFER:
            base = np.arcsinh(base / signal[s, EXCHANGE])
        if kind[s] == SOC:
            value = 0.0
            for mode in range(3):
                keep = np.exp(-signal[s, POLE + mode] / slowed)
                filters[s, mode] = keep * filters[s, mode] + (1.0 - keep) * DIFFUSION_GAINS[mode] * base
                value += signal[s, GAIN] * filters[s, mode]
        elif kind[s] == FILTERED or kind[s] == CHARGE_TRANSFER or kind[s] == SQUARED:
            filters[s, 0] = signal[s, POLE] * filters[s, 0] + (1.0 - signal[s, POLE]) * base
            value = signal[s, GAIN] * filters[s, 0]
            if kind[s] == SQUARED:
                value *= np.abs(value)
        elif kind[s] == RELAXATION:
            value = change
            for stage in range(3):
                pole = signal[s, POLE + stage]
                filters[s, stage] = pole * filters[s, stage] + (1.0 - pole) * value
                value = filters[s, stage]
            value *= signal[s, GAIN]
        elif kind[s] == HYSTERESIS:
            value = held[1]
        elif kind[s] == HYSTERESIS_STATE:
            keep = np.exp(-signal[s, RATE] * np.abs(current_A))
            filters[s, 0] = keep * filters[s, 0] + (1.0 - keep) * np.sign(current_A)
            value = filters[s, 0]
        elif kind[s] == TEMPERATURE:
            value = temperature_degC
        else:
            value = 1.0 / (temperature_degC + 273.15)
        # Of a state of charge only the shift is known yet; the rest is added when the estimate is.
        now[s] = value if kind[s] == SOC else (value - signal[s, LOW]) / signal[s, SPAN]
    if first:
        for lag in range(history.shape[0]):
            for s in range(n_signals):
                history[lag, s] = now[s]
                if kind[s] == SOC:
                    history[lag, s] = (x[size - 1] + now[s] - signal[s, LOW]) / signal[s, SPAN]
    total = 0.0
    largest = -np.inf
    weight = np.empty(n_models)
    for i in range(n_models):
        exponent = 0.0
        for j in range(n_axes):
            z = now[axis_signal[j]] if axis_lag[j] == 0 else history[axis_lag[j] - 1, axis_signal[j]]
            scaled = (z - centres[i, j]) * inverse_widths[i, j]
            exponent -= 0.5 * scaled * scaled
        weight[i] = exponent
        largest = max(largest, exponent)
    for i in range(n_models):
        weight[i] = np.exp(weight[i] - largest)
        total += weight[i]
    blended = np.zeros(n_params)
    k_gain = np.zeros(size)
    steady_variance = 0.0
    for i in range(n_models):
        phi = weight[i] / total
        for p in range(n_params):
            blended[p] += phi * theta[i, p]
        for s in range(size):
            k_gain[s] += phi * gains[i, s]
        steady_variance += phi * gains[i, size]
    # Prediction.
    y = 0.0
    if first and order > 0:
        # No output before the first sample: start from the measurement.
        y = voltage if not np.isnan(voltage) else x[0]
        for lag in range(order):
            x[lag] = y
    else:
        for lag in range(order):
            y += blended[lag] * x[lag]
        for t in range(tap_signal.shape[0]):
            u = now[tap_signal[t]] if tap_lag[t] == 0 else history[tap_lag[t] - 1, tap_signal[t]]
            y += blended[order + t] * u
        y += blended[n_params - 1]
    transition = np.zeros((size, size))
    for lag in range(order):
        transition[0, lag] = blended[lag]
    for t in range(tap_signal.shape[0]):
        if kind[tap_signal[t]] == SOC and tap_lag[t] == 1:
            transition[0, size - 1] += blended[order + t] / signal[tap_signal[t], SPAN]
    for row in range(1, size - 1):
        transition[row, row - 1] = 1.0
    transition[size - 1, size - 1] = 1.0
    if first:
        soc = x[size - 1]
    else:
        soc = x[size - 1] + constants[0] * current_A
        covariance[:, :] = transition @ covariance @ transition.T
        covariance[0, 0] += constants[1]
        covariance[size - 1, size - 1] += constants[2]
        for row in range(size - 2, 0, -1):
            x[row] = x[row - 1]
    x[0] = y
    x[size - 1] = soc
    # Correction.
    innovation_variance = covariance[0, 0] + constants[3]
    if covariance[size - 1, size - 1] > START_UP_RATIO * steady_variance:
        # Far less is known than in the steady state that the gains were designed for: the same filter's gain for
        # what is known now, until the two meet.
        for s in range(size):
            k_gain[s] = covariance[s, 0] / innovation_variance
    innovation = np.nan
    if not np.isnan(voltage):
        innovation = voltage - y
        if not first:
            for s in range(size):
                x[s] += k_gain[s] * innovation
            # Joseph form with the gain that was used, so that the covariance holds for a gain that is not optimal.
            correction = np.eye(size)
            for s in range(size):
                correction[s, 0] -= k_gain[s]
            covariance[:, :] = correction @ covariance @ correction.T
            for r in range(size):
                for c in range(size):
                    covariance[r, c] += k_gain[r] * constants[3] * k_gain[c]
    # A state of charge beyond empty or full is no estimate; the slack leaves room for a capacity that is a little off.
    x[size - 1] = min(max(x[size - 1], -SOC_SLACK), 1.0 + SOC_SLACK)
    for lag in range(history.shape[0] - 1, 0, -1):
        for s in range(n_signals):
            history[lag, s] = history[lag - 1, s]
    for s in range(n_signals):
        history[0, s] = now[s]
        if kind[s] == SOC:
            history[0, s] = (x[size - 1] + now[s] - signal[s, LOW]) / signal[s, SPAN]
    held[0] = current_A
    held[2] = temperature_degC
    held[3] += 1.0
    out[0] = x[size - 1]
    out[1] = covariance[size - 1, size - 1]
    out[2] = y
    out[3] = innovation
    out[4] = innovation_variance


@njit(cache=True)
def replay(
    theta: np.ndarray,
    centres: np.ndarray,
    inverse_widths: np.ndarray,
    gains: np.ndarray,
    order: int,
    kind: np.ndarray,
    signal: np.ndarray,
    tap_signal: np.ndarray,
    tap_lag: np.ndarray,
    axis_signal: np.ndarray,
    axis_lag: np.ndarray,
    constants: np.ndarray,
    x: np.ndarray,
    covariance: np.ndarray,
    filters: np.ndarray,
    history: np.ndarray,
    held: np.ndarray,
    current_A: np.ndarray,
    voltage: np.ndarray,
    temperature_degC: np.ndarray,
    out: np.ndarray,
) -> None:
    """Run `step` over whole arrays; `out` is (N, N_OUT)."""
    for k in range(current_A.shape[0]):
        step(
            theta, centres, inverse_widths, gains, order, kind, signal, tap_signal, tap_lag,
            axis_signal, axis_lag, constants, x, covariance, filters, history, held,
            current_A[k], voltage[k], temperature_degC[k], out[k],
        )  # fmt: skip
