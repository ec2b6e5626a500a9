import json

import numpy as np
import pytest
from scipy.signal import lfilter

from models.comparison.residuals import residual_statistics

N = 20_000


def test_an_autoregression_is_found_again() -> None:
    rng = np.random.default_rng(0)
    residual = 0.004 + lfilter([1.0], [1.0, -1.2, 0.35], 1e-3 * rng.standard_normal(N))
    found = residual_statistics(residual, 1.0)
    np.testing.assert_allclose(found["autoregression"][:2], [1.2, -0.35], atol=0.03)
    assert len(found["autoregression"]) <= 3
    assert found["innovation_mV"] == pytest.approx(1.0, rel=0.02)
    assert found["bias_mV"] == pytest.approx(4.0, abs=0.2)
    lag = {row["lag_s"]: row["value"] for row in found["autocorrelation"]}
    assert lag[1.0] == pytest.approx(1.2 / 1.35, abs=0.01)
    assert abs(lag[1000.0]) < 0.15


@pytest.mark.parametrize("n", [N, N + 1])
def test_the_spectrum_adds_up_and_names_the_band(n: int) -> None:
    residual = 2e-3 * np.sin(2.0 * np.pi * 0.02 * np.arange(n) * 0.5)
    found = residual_statistics(residual, 0.5)
    total = sum(row["rms_mV"] ** 2 for row in found["spectrum"])
    assert total == pytest.approx(found["std_mV"] ** 2, rel=1e-6)
    largest = max(found["spectrum"], key=lambda row: row["rms_mV"])
    assert largest["from_Hz"] == pytest.approx(0.01) and largest["to_Hz"] == pytest.approx(0.1)
    assert largest["rms_mV"] == pytest.approx(np.sqrt(2.0), rel=0.01)
    assert found["spectrum"][-1]["to_Hz"] == 1.0


def test_gaps_change_little() -> None:
    rng = np.random.default_rng(1)
    residual = lfilter([1.0], [1.0, -0.9], 1e-3 * rng.standard_normal(N))
    holed = residual.copy()
    holed[rng.random(N) < 0.2] = np.nan
    whole, part = residual_statistics(residual, 1.0), residual_statistics(holed, 1.0)
    assert part["n_samples"] < whole["n_samples"]
    assert part["autoregression"][0] == pytest.approx(whole["autoregression"][0], abs=0.05)
    total = sum(row["rms_mV"] ** 2 for row in part["spectrum"])
    assert total == pytest.approx(part["std_mV"] ** 2, rel=1e-6)


@pytest.mark.parametrize("residual", [np.full(100, np.nan), np.zeros(100), np.ones(5)])
def test_nothing_to_say_is_json(residual: np.ndarray) -> None:
    found = residual_statistics(residual, 1.0)
    assert found["spectrum"] == [] and found["autoregression"] == []
    json.dumps(found, allow_nan=False)
