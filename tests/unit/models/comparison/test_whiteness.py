"""White noise is told from an error that hangs together, with the size of both and the time in which it fades."""

import numpy as np
import pytest
from scipy.signal import lfilter

from models.comparison.simulated_runs import RunComparison
from models.comparison.whiteness import whiteness
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries

N = 12_000
DT_S = 2.0


def compared(error_V: np.ndarray, inside: np.ndarray | None = None) -> RunComparison:
    n, flat = len(error_V), np.zeros(len(error_V))
    run = to_grid(TimeSeries(DT_S * np.arange(n), flat, flat + 3.7, flat + 25.0, name="r"), DT_S)
    return RunComparison(run, 3.7 + error_V, flat + 0.5, np.ones(n, bool) if inside is None else inside)


def fading(time_s: float, std_V: float, seed: int = 1) -> np.ndarray:
    keep = np.exp(-DT_S / time_s)
    noise = np.random.default_rng(seed).standard_normal(N)
    return std_V * np.sqrt(1.0 - keep**2) * lfilter([1.0], [1.0, -keep], noise)


def white(std_V: float) -> np.ndarray:
    return std_V * np.random.default_rng(2).standard_normal(N)


def test_noise_is_white() -> None:
    found = whiteness([compared(white(1e-3))])
    assert found is not None and found["white_share"] > 0.97
    assert found["white_mV"] == pytest.approx(1.0, rel=0.03)
    assert "white noise: nothing" in found["text"]


def test_an_error_that_hangs_together_is_told_from_the_noise_on_it() -> None:
    found = whiteness([compared(white(1e-3) + fading(120.0, 3e-3))])
    assert found is not None
    # Kalman: with noise of 1 mV^2, a state that keeps the share a and has q new in each sample is foretold with P,
    # where P = a^2 P / (P + 1) + q.
    keep2 = np.exp(-2.0 * DT_S / 120.0)
    new = 9.0 * (1.0 - keep2)
    half = 0.5 * (keep2 + new - 1.0)
    foretold = half + np.sqrt(half**2 + new)
    assert found["white_mV"] == pytest.approx(np.sqrt(foretold + 1.0), rel=0.03)
    assert found["correlated_mV"] == pytest.approx(np.sqrt(9.0 - foretold), rel=0.25)
    assert 60.0 < found["correlation_time_s"] < 240.0
    assert "% of the squared error hangs together, for" in found["text"]


def test_what_lies_outside_the_trained_domain_is_left_out() -> None:
    inside = np.arange(N) >= N // 4
    found = whiteness([compared(white(1e-3) + np.where(inside, 0.0, 0.5), inside)])
    assert found is not None and found["white_mV"] == pytest.approx(1.0, rel=0.05)


def test_too_few_samples_say_nothing() -> None:
    assert whiteness([compared(white(1e-3)[:40])]) is None
    assert whiteness([compared(np.zeros(N))]) is None
