"""The delay between voltage and current, told from how the voltage answers steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.identification.dead_time import dead_time


def _steps(rng: np.random.Generator, n: int) -> FloatArray:
    return np.repeat(rng.uniform(-2.0, 1.0, n // 7 + 1), 7)[:n]


def _swings(rng: np.random.Generator, n: int) -> FloatArray:
    return np.convolve(rng.normal(0.0, 1.0, n + 4), np.ones(5) / 5.0, "valid")


def _run(current_A: FloatArray, samples: int, noise_V: float = 1e-3, tau_s: float = 20.0) -> GridRun:
    """A resistance and a slower part twice as large; the voltage comes so many samples late."""
    slow = np.zeros(len(current_A))
    for k in range(1, len(slow)):
        slow[k] = slow[k - 1] + (current_A[k - 1] - slow[k - 1]) * (1.0 - np.exp(-1.0 / tau_s))
    voltage_V = 3.6 + 0.02 * current_A + 0.04 * slow
    voltage_V += np.random.default_rng(9).normal(0.0, noise_V, len(voltage_V))
    time_s = np.arange(len(current_A), dtype=float)
    late = np.interp(time_s - samples, time_s, voltage_V)
    return to_grid(TimeSeries(time_s, current_A, late, np.full(len(time_s), 25.0)), 1.0)


@pytest.mark.parametrize("samples", range(-5, 6))
@pytest.mark.parametrize("shape", [_steps, _swings])
def test_each_delay_of_whole_samples_is_told(
    samples: int, shape: Callable[[np.random.Generator, int], FloatArray]
) -> None:
    rng = np.random.default_rng(4)
    found = dead_time([_run(shape(rng, 3000), samples), _run(shape(rng, 2000), samples)])
    assert found is not None and found.samples == samples
    assert found.after_V <= found.before_V
    if samples:
        assert found.after_V < 0.8 * found.before_V


def test_missing_voltages_are_passed_over() -> None:
    run = _run(_steps(np.random.default_rng(4), 3000), 2)
    holes = np.where(np.random.default_rng(5).random(3000) < 0.2, np.nan, run.voltage_V)
    found = dead_time([replace(run, voltage_V=holes)])
    assert found is not None and found.samples == 2


def test_runs_that_contradict_each_other_tell_nothing() -> None:
    current_A = _steps(np.random.default_rng(4), 3000)
    assert dead_time([_run(current_A, 0), _run(current_A, 2)]) is None


def test_a_run_without_steps_says_neither_yes_nor_no() -> None:
    steps, steady = _steps(np.random.default_rng(4), 3000), np.full(3000, -1.0)
    found = dead_time([_run(steps, 1), _run(steady, 0)])
    assert found is not None and found.samples == 1
    assert dead_time([_run(steady, 3)]) is None


def test_noise_alone_has_no_delay() -> None:
    current_A = _steps(np.random.default_rng(4), 3000)
    deaf = replace(_run(current_A, 0), voltage_V=np.random.default_rng(6).normal(3.6, 0.01, 3000))
    assert dead_time([deaf]) is None


def test_a_short_run_tells_nothing() -> None:
    assert dead_time([_run(np.array([0.0, 1.0, 0.0, -1.0]), 0)]) is None
