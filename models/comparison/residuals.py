"""Figures of a free run's residual: size, memory and spectrum."""

from __future__ import annotations

from typing import TypedDict

import numpy as np
from scipy.linalg import solve_toeplitz

from models.data.timeseries import FloatArray

_LARGEST_ORDER = 8
_LAGS_S = (1.0, 10.0, 100.0, 1000.0)
_FEWEST = 32


class Lag(TypedDict):
    """Autocorrelation at a lag."""

    lag_s: float
    value: float


class Band(TypedDict):
    """Residual in a band of frequency."""

    from_Hz: float
    to_Hz: float
    rms_mV: float


class ResidualStatistics(TypedDict):
    """Size, memory and spectrum of a residual; see `residual_statistics`."""

    n_samples: int
    std_mV: float | None
    bias_mV: float | None
    autocorrelation: list[Lag]
    autoregression: list[float]
    innovation_mV: float | None
    spectrum: list[Band]


def residual_statistics(residual_V: FloatArray, dt_s: float) -> ResidualStatistics:
    """Size, autocorrelation, autoregression and power by decade of frequency.

    Parameters
    ----------
    residual_V : (n,) evenly spaced, NaN where missing
    dt_s : sampling time in s

    Returns
    -------
    dict
        `std_mV`, `bias_mV`, `n_samples`; `autocorrelation`: pairs of lag in s and value; `autoregression`: coefficients
        of e(k) = sum c_j e(k-j) + innovation, its order chosen by the Bayesian information criterion, and
        `innovation_mV`; `spectrum`: the residual's RMS in each band of frequency in Hz, whose squares add up to the
        variance. Empty lists where fewer than 32 values are known.

    Notes
    -----
    Gaps count as zeros in the products, and only pairs of known values are counted.
    """
    known = ~np.isnan(residual_V)
    n = int(known.sum())
    out: ResidualStatistics = {
        "n_samples": n,
        "std_mV": 1e3 * float(np.std(residual_V[known])) if n else None,
        "bias_mV": 1e3 * float(np.mean(residual_V[known])) if n else None,
        "autocorrelation": [],
        "autoregression": [],
        "innovation_mV": None,
        "spectrum": [],
    }
    if n < _FEWEST or not np.ptp(residual_V[known]) > 0.0:
        return out
    centred = np.where(known, residual_V - np.mean(residual_V[known]), 0.0)
    covariance, _ = autocovariance(centred, known)
    lags = [(lag_s, round(lag_s / dt_s)) for lag_s in _LAGS_S]
    out["autocorrelation"] = [
        {"lag_s": k * dt_s, "value": float(covariance[k] / covariance[0])}
        for _, k in dict.fromkeys(lags)
        if 1 <= k < len(residual_V) // 4
    ]
    coefficients, variance = autoregression(covariance, n)
    out["autoregression"] = coefficients.tolist()
    out["innovation_mV"] = 1e3 * float(np.sqrt(variance))
    out["spectrum"] = _spectrum(centred, n, dt_s)
    return out


def autocovariance(centred: FloatArray, known: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """(n,) mean products over known pairs, and (n,) how many those are; values that are not known must be zero."""
    size = 2 ** int(np.ceil(np.log2(2 * len(centred))))

    def products(values: FloatArray) -> FloatArray:
        spectrum = np.abs(np.fft.rfft(values, size)) ** 2
        return np.fft.irfft(spectrum, size)[: len(values)]

    pairs = np.maximum(np.round(products(known.astype(np.float64))), 1.0)
    return products(centred) / pairs, pairs


def autoregression(covariance: FloatArray, n: int) -> tuple[FloatArray, float]:
    """Coefficients and innovation variance of the order with the least Bayesian information criterion."""
    best = (np.zeros(0), float(covariance[0]))
    least = n * np.log(covariance[0])
    for order in range(1, min(_LARGEST_ORDER, n // 4) + 1):
        coefficients = np.asarray(solve_toeplitz(covariance[:order], covariance[1 : order + 1]), dtype=np.float64)
        variance = float(covariance[0] - coefficients @ covariance[1 : order + 1])
        if not variance > 0.0:
            break
        criterion = n * np.log(variance) + order * np.log(n)
        if criterion < least:
            least, best = criterion, (coefficients, variance)
    return best


def _spectrum(centred: FloatArray, n_known: int, dt_s: float) -> list[Band]:
    frequency = np.fft.rfftfreq(len(centred), dt_s)[1:]
    power = 2.0 * np.abs(np.fft.rfft(centred))[1:] ** 2 / (len(centred) * n_known)
    if len(centred) % 2 == 0:
        power[-1] *= 0.5
    decade = np.floor(np.log10(frequency) + 1e-9).astype(np.int64)
    return [
        {
            "from_Hz": float(10.0**d),
            "to_Hz": float(min(10.0 ** (d + 1), 0.5 / dt_s)),
            "rms_mV": 1e3 * float(np.sqrt(power[decade == d].sum())),
        }
        for d in range(int(decade.min()), int(decade.max()) + 1)
    ]
