"""How much of a free run's error is white, and how long the rest hangs together."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from models.comparison.residuals import autocovariance, autoregression
from models.comparison.simulated_runs import RunComparison
from models.data.timeseries import FloatArray

_FEWEST = 64
# A share above this is called white; below, the error hangs together.
_WHITE = 0.9
_MINUTE_S, _HOUR_S = 60.0, 3600.0


class WhiteParts(TypedDict):
    """White and correlated part of a squared error; `correlation_time_s` is None where all is white."""

    white_share: float
    white_mV: float
    correlated_mV: float
    correlation_time_s: float | None


class Whiteness(WhiteParts):
    """The same in words, too."""

    text: str


def whiteness(compared: list[RunComparison]) -> Whiteness | None:
    """Part the squared error into a white part and what can be foretold from the error just before it.

    Parameters
    ----------
    compared : runs beside their free runs; samples outside the trained domain are left out where any lie inside

    Returns
    -------
    dict or None
        ``white_share`` of the squared error, ``white_mV`` (RMS of what an autoregression cannot foretell),
        ``correlated_mV`` (RMS of the rest), ``correlation_time_s`` (after which the rest has faded to 1/e, None where
        all is white) and ``text``; None where fewer than 64 errors are known. The best of models leaves a white error.

    Notes
    -----
    A mean error counts as an error that never fades: a better model would not have it. Beside the measurement's noise
    the white part holds what is new in the rest at each sample.
    """
    inside = any((each.inside & ~np.isnan(each.residual_V)).any() for each in compared)
    residuals = [np.where(each.inside, each.residual_V, np.nan) if inside else each.residual_V for each in compared]
    n = sum(int((~np.isnan(residual)).sum()) for residual in residuals)
    covariance = _pooled(residuals)
    if n < _FEWEST or not covariance[0] > 0.0:
        return None
    coefficients, innovation = autoregression(covariance, n)
    rest = max(float(covariance[0]) - innovation, 0.0) if len(coefficients) else 0.0
    white = 1.0 - rest / float(covariance[0])
    time_s = None
    if white < _WHITE:
        faded = np.flatnonzero(covariance[1:] < rest / np.e)
        time_s = compared[0].run.dt_s * float(faded[0] + 1 if len(faded) else len(covariance))
    found: WhiteParts = {
        "white_share": white,
        "white_mV": 1e3 * float(np.sqrt(white * covariance[0])),
        "correlated_mV": 1e3 * float(np.sqrt(rest)),
        "correlation_time_s": time_s,
    }
    return {**found, "text": _in_words(found)}


def _pooled(residuals: list[FloatArray]) -> FloatArray:
    """Mean products at each lag up to a quarter of the longest run, over all runs."""
    lags = max(max(len(residual) for residual in residuals) // 4, 1)
    total, pairs = np.zeros(lags), np.zeros(lags)
    for residual in residuals:
        known = ~np.isnan(residual)
        products, counted = autocovariance(np.where(known, residual, 0.0), known)
        reach = min(lags, len(residual))
        total[:reach] += (products * counted)[:reach]
        pairs[:reach] += counted[:reach]
    return total / np.maximum(pairs, 1.0)


def _in_words(found: WhiteParts) -> str:
    if found["correlation_time_s"] is None:
        return "the error is white noise: nothing that a model could foretell is left in it"
    return (
        f"{100.0 * (1.0 - found['white_share']):.0f} % of the squared error hangs together, for about "
        f"{_duration(found['correlation_time_s'])}; its white part is {found['white_mV']:.2f} mV"
    )


def _duration(time_s: float) -> str:
    for unit_s, unit in ((_HOUR_S, "h"), (_MINUTE_S, "min")):
        if time_s >= 1.5 * unit_s:
            return f"{time_s / unit_s:.0f} {unit}"
    return f"{time_s:.0f} s"
