"""How a model's error runs over one variable at a time, after charge and after discharge: the pictures of effects."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from models.comparison.samples import REST_C_RATE, ErrorSamples, spread
from models.data.timeseries import FloatArray
from models.effects.effect import Variable

_BINS = 20
_FEWEST_SAMPLES = 8
_LEAST_SPREAD_K = 1.0
_LONGEST_S = 3600.0
# Resistance is read only where a current flows that one would call a load.
_LOAD_C_RATE = 0.2


class ErrorProfile(TypedDict):
    """Mean error in bins of one variable; see `error_profiles`."""

    variable: str
    unit: str
    quantity: str
    at: list[float]
    after_charge: list[float]
    after_discharge: list[float]


def error_profiles(samples: ErrorSamples) -> list[ErrorProfile]:
    """Mean error in bins of each variable that moves, apart for the direction of the last current.

    Returns
    -------
    list of dict
        Each with ``variable``, ``unit``, ``quantity`` ("error_mV", or "resistance_mOhm": error over current), and of
        each bin its middle ``at`` and the means ``after_charge`` and ``after_discharge``, NaN where fewer than 8
        samples lie. Variables: ``soc`` (all samples), ``soc_at_rest``, ``since_step_s``, ``current_A``,
        ``throughput_Ah``, ``time_h`` and, where the temperature moves by more than 1 K, ``temperature_degC`` (as a
        resistance).
    """
    error_mV = 1e3 * samples.error_V
    rest, load = np.abs(samples.c_rate) <= REST_C_RATE, np.abs(samples.c_rate) >= _LOAD_C_RATE
    current_A = samples.c_rate * samples.capacity_Ah
    since = np.clip(samples.since_step_s, 1.0, _LONGEST_S)
    everything = np.ones(len(error_mV), dtype=bool)
    found = [
        _profile("soc", "1", samples.soc, error_mV, samples, everything),
        _profile("soc_at_rest", "1", samples.soc, error_mV, samples, rest),
        _profile("since_step_s", "s", since, error_mV, samples, everything, even_in_log=True),
        _profile("current_A", "A", current_A, error_mV, samples, ~rest),
        _profile("throughput_Ah", "Ah", samples.throughput_Ah, error_mV, samples, everything),
        _profile("time_h", "h", samples.progress * samples.total_s / 3600.0, error_mV, samples, everything),
    ]
    if spread(samples.temperature_degC) >= _LEAST_SPREAD_K:
        over = load & ~np.isnan(samples.temperature_degC)
        resistance = np.divide(error_mV, current_A, out=np.zeros_like(error_mV), where=over)
        profile = _profile("temperature_degC", "degC", samples.temperature_degC, resistance, samples, over)
        found.append(profile and {**profile, "quantity": "resistance_mOhm"})
    return [each for each in found if each is not None]


def _profile(
    variable: Variable,
    unit: str,
    values: FloatArray,
    shown: FloatArray,
    samples: ErrorSamples,
    chosen: np.ndarray,
    even_in_log: bool = False,
) -> ErrorProfile | None:
    if np.count_nonzero(chosen) < _FEWEST_SAMPLES or spread(values[chosen]) <= 0.0:
        return None
    low, high = values[chosen].min(), values[chosen].max()
    edges = np.geomspace(low, high, _BINS + 1) if even_in_log else np.linspace(low, high, _BINS + 1)
    middle = np.sqrt(edges[1:] * edges[:-1]) if even_in_log else 0.5 * (edges[1:] + edges[:-1])
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, _BINS - 1)
    return {
        "variable": variable,
        "unit": unit,
        "quantity": "error_mV",
        "at": middle.tolist(),
        "after_charge": _means(place, shown, chosen & (samples.direction > 0)),
        "after_discharge": _means(place, shown, chosen & (samples.direction < 0)),
    }


def _means(place: np.ndarray, shown: FloatArray, chosen: np.ndarray) -> list[float]:
    n = np.bincount(place[chosen], minlength=_BINS).astype(float)
    total = np.bincount(place[chosen], shown[chosen], minlength=_BINS)
    return np.divide(total, n, out=np.full(_BINS, np.nan), where=n >= _FEWEST_SAMPLES).tolist()
