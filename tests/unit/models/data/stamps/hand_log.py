"""A log written down by hand: an ohmic drop, a branch of 30 s, a straight open-circuit curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.timeseries import TimeSeries

CAPACITY_AH = 2.0


def log(current_A: np.ndarray, noise_V: float = 2e-4) -> TimeSeries:
    """One sample a second."""
    n = len(current_A)
    branch = np.zeros(n)
    for k in range(1, n):
        branch[k] = branch[k - 1] + (current_A[k] - branch[k - 1]) / 30.0
    counted = 0.5 + np.cumsum(current_A) / 3600.0 / CAPACITY_AH
    noise = noise_V * np.random.default_rng(0).standard_normal(n)
    voltage_V = 3.2 + counted + 0.03 * current_A + 0.03 * branch + noise
    return TimeSeries(np.arange(n) * 1.0, current_A, voltage_V, np.full(n, 25.0), name="log")


def pulsed(n: int = 6000, rest_s: int = 90, load_s: int = 60) -> np.ndarray:
    """Loads of a minute with rests between them."""
    rng = np.random.default_rng(1)
    current = np.zeros(n)
    for first in range(rest_s, n, rest_s + load_s):
        current[first : first + load_s] = rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 4.0)
    return current


def part(run: TimeSeries, kept: np.ndarray) -> TimeSeries:
    """Some of the samples."""
    names = ("time_s", "current_A", "voltage_V", "temperature_degC")
    return replace(run, **{name: getattr(run, name)[kept] for name in names})
