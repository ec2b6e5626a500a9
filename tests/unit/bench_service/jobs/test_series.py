"""The noise floor of several stored runs."""

import numpy as np
import pytest

from bench_service.jobs.series import noise_floor_mV
from models.data.timeseries import TimeSeries


def still(n: int, noise_V: float, seed: int = 0) -> TimeSeries:
    """A cell at rest, measured with noise."""
    voltage_V = 3.7 + noise_V * np.random.default_rng(seed).standard_normal(n)
    return TimeSeries(np.arange(float(n)), np.zeros(n), voltage_V, np.full(n, 25.0))


def test_it_is_the_middle_one_in_millivolts() -> None:
    runs = [still(5000, noise_V, seed) for seed, noise_V in enumerate((1e-3, 3e-3, 9e-3))]
    assert noise_floor_mV(runs, 1.0) == pytest.approx(3.0, rel=0.05)


def test_runs_that_cannot_tell_do_not_count() -> None:
    assert noise_floor_mV([still(10, 5e-3), still(5000, 1e-3)], 1.0) == pytest.approx(1.0, rel=0.05)
    assert noise_floor_mV([still(10, 5e-3)], 1.0) is None
    assert noise_floor_mV([], 1.0) is None
