"""A cell whose equations are written here, apart from models and simulators: OCV line, R0 and one RC pair."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import TimeSeries

CAPACITY_AH = 2.0
R0_OHM = 0.02
R1_OHM = 0.015
TAU_S = 20.0


def ocv_V(soc: np.ndarray) -> np.ndarray:
    """Open-circuit voltage in V."""
    return 3.4 + 0.7 * soc + 0.05 * np.sin(6.0 * soc)


def excitation_A(n: int, rng: np.random.Generator, largest_A: float = 4.0) -> np.ndarray:
    """Random steps of 5 to 60 samples with rests, without net charge on average."""
    current = np.zeros(n)
    k = 0
    while k < n:
        length = int(rng.integers(5, 60))
        if rng.random() < 0.7:
            current[k : k + length] = rng.uniform(-largest_A, largest_A)
        k += length
    return current


def run(
    n: int, seed: int, noise_V: float = 0.0, initial_soc: float = 0.6, drift_A: float = 0.0, name: str = "run"
) -> TimeSeries:
    """Simulate n samples at 1 s."""
    rng = np.random.default_rng(seed)
    current = excitation_A(n, rng) + drift_A
    current[0] = 0.0
    soc = initial_soc + np.concatenate([[0.0], np.cumsum(current[1:])]) / (3600.0 * CAPACITY_AH)
    pole = np.exp(-1.0 / TAU_S)
    u1 = np.zeros(n)
    for k in range(1, n):
        u1[k] = pole * u1[k - 1] + (1.0 - pole) * R1_OHM * current[k]
    voltage = ocv_V(soc) + R0_OHM * current + u1 + noise_V * rng.standard_normal(n)
    temperature = 25.0 + 3.0 * np.sin(np.arange(n) / n * 6.0)
    return TimeSeries(np.arange(n) * 1.0, current, voltage, temperature, None, soc, name)
