"""Training data written down by hand: a straight open-circuit curve and one resistance."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import TimeSeries
from models.pipeline.training import Training, training

CAPACITY_AH = 2.0
RESISTANCE_OHM = 0.05


def run(current_A: np.ndarray, soc: float, dt_s: float = 10.0, name: str = "run") -> TimeSeries:
    """A run on an even clock; the state of charge is told at its first sample only."""
    n = len(current_A)
    counted = soc + np.concatenate([[0.0], np.cumsum(current_A[1:])]) * dt_s / 3600.0 / CAPACITY_AH
    voltage_V = 3.2 + counted + RESISTANCE_OHM * current_A
    time_s = np.arange(n) * dt_s
    told = np.where(time_s == 0.0, soc, np.nan)
    return TimeSeries(time_s, np.asarray(current_A, float), voltage_V, np.full(n, 25.0), None, told, name)


def pulses(n: int = 1440, rest: int = 60, least: float = -2.0, most: float = 1.0) -> np.ndarray:
    """A rest, then two minutes each of drawn currents and of rest that take the charge slowly down."""
    rng = np.random.default_rng(3)
    drawn = np.repeat(rng.uniform(least, most, n // 24 + 1), 24)[:n]
    drawn[np.arange(n) % 24 < 12] = 0.0
    drawn[:rest] = 0.0
    return drawn


def taken(*runs: TimeSeries, **options: float) -> Training:
    """The runs as a fit takes them."""
    return training(list(runs), CAPACITY_AH, dt_s=options.get("dt_s", 10.0))
