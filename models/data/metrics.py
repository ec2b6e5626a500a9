"""Figures of a voltage error, and the noise floor of a measured voltage."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from models.data.timeseries import FloatArray


class Metrics(TypedDict):
    """Figures of a free run: errors in mV, `nrmse` over the range of the measured voltage, and how many samples."""

    rmse_mV: float
    mae_mV: float
    p95_mV: float
    max_mV: float
    bias_mV: float
    nrmse: float
    n_samples: int


class RunMetrics(Metrics):
    """The same of one run, with its name."""

    run: str


def metrics(measured_V: FloatArray, simulated_V: FloatArray) -> Metrics:
    """Figures of simulated against measured voltage; samples where either is missing do not count.

    Parameters
    ----------
    measured_V, simulated_V : (n,) in V

    Returns
    -------
    dict with `rmse_mV`, `mae_mV`, `p95_mV`, `max_mV`, `bias_mV` (measured minus simulated), `nrmse` (RMSE over the
    range of the measured voltage) and `n_samples`; zeros where nothing could be compared.
    """
    error = measured_V - simulated_V
    known = ~np.isnan(error)
    if not known.any():
        return {
            "rmse_mV": 0.0,
            "mae_mV": 0.0,
            "p95_mV": 0.0,
            "max_mV": 0.0,
            "bias_mV": 0.0,
            "nrmse": 0.0,
            "n_samples": 0,
        }
    error_mV = 1e3 * error[known]
    size = np.abs(error_mV)
    rmse_mV = float(np.sqrt(np.mean(error_mV**2)))
    span_mV = 1e3 * float(np.ptp(measured_V[known]))
    return {
        "rmse_mV": rmse_mV,
        "mae_mV": float(size.mean()),
        "p95_mV": float(np.percentile(size, 95.0)),
        "max_mV": float(size.max()),
        "bias_mV": float(error_mV.mean()),
        "nrmse": rmse_mV / span_mV if span_mV > 0 else 0.0,
        "n_samples": int(known.sum()),
    }


def noise_floor_V(voltage_V: FloatArray, current_A: FloatArray) -> float:
    """Standard deviation of the voltage's measurement noise, from its second differences while the current is steady.

    Parameters
    ----------
    voltage_V, current_A : (n,) evenly spaced

    Returns
    -------
    float, in V; NaN where fewer than 20 steady triples exist

    Notes
    -----
    The second difference of white noise has 6 times its variance, while a smooth voltage has almost none. The median
    absolute value keeps steps and spikes out; a quantised, noise-free voltage gives the quantisation noise instead.
    """
    second = voltage_V[2:] - 2.0 * voltage_V[1:-1] + voltage_V[:-2]
    spread = np.maximum.reduce([current_A[2:], current_A[1:-1], current_A[:-2]]) - np.minimum.reduce(
        [current_A[2:], current_A[1:-1], current_A[:-2]]
    )
    quiet = ~np.isnan(second) & (spread <= 0.01 * max(float(np.ptp(current_A)), 1e-9))
    if quiet.sum() < 20:
        return float("nan")
    values = second[quiet]
    robust = float(np.median(np.abs(values))) / 0.6744897501960817
    if robust == 0.0:
        # More than half of the triples read the same step of the converter.
        robust = float(np.sqrt(np.mean(np.clip(values, *np.percentile(values, [1.0, 99.0])) ** 2)))
    return robust / np.sqrt(6.0)
