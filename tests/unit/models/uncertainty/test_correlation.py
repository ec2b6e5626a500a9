import numpy as np
import pytest
from scipy.signal import lfilter

from models.uncertainty.correlation import fit_correlation


def memory(n: int, time: float, rng: np.random.Generator) -> np.ndarray:
    keep = np.exp(-1.0 / time)
    return lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(n + 5000))[5000:]


@pytest.mark.parametrize("seed", range(5))
def test_white_residuals_are_white(seed: int) -> None:
    found = fit_correlation(0.01 * np.random.default_rng(seed).standard_normal(8000), np.array([0, 3000]))
    assert found.inflation < 2.5
    assert found.white > 0.98


@pytest.mark.parametrize("seed", range(3))
def test_a_slow_part_under_noise_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    found = fit_correlation(2.0 * rng.standard_normal(20_000) + memory(20_000, 60.0, rng), np.array([0]))
    true = np.exp(-np.array([1.0, 20.0, 60.0, 200.0]) / 60.0) / 5.0
    np.testing.assert_allclose(found.at(np.array([1.0, 20.0, 60.0, 200.0])), true, atol=0.04)
    # The slowest frequencies are few: what they add to a long mean is known to a factor only.
    assert 0.6 < found.inflation / ((4.0 + 120.0) / 5.0) < 1.8
    assert found.at(np.array([0.0]))[0] == pytest.approx(1.0)


def test_gaps_and_short_parts_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    residual = rng.standard_normal(6000) + memory(6000, 30.0, rng)
    holed = residual.copy()
    holed[rng.random(6000) < 0.1] = np.nan
    whole, with_gaps = fit_correlation(residual, np.array([0])), fit_correlation(holed, np.array([0, 5995]))
    assert with_gaps.inflation == pytest.approx(whole.inflation, rel=0.3)


def test_nothing_known_counts_as_white() -> None:
    assert fit_correlation(np.full(100, np.nan), np.array([0])).inflation == 1.0
