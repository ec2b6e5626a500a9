"""Where a model is off: planted regions are found, in words and on the map, and what lies outside is kept apart."""

import json

import numpy as np
import pytest

from bench_service.jobs.modelling import plain
from models.comparison.samples import since_step_s
from models.comparison.simulated_runs import RunComparison
from models.comparison.where import error_map
from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from tests.unit.models import hand_network

N = 6000


def compared(extra_V, *, temperature_degC=25.0, inside=None):
    """A run up and down in SoC with 1 mV of noise; `extra_V` maps (soc, current) to an error on top."""
    rng = np.random.default_rng(7)
    current = np.where(np.arange(N) // 500 % 2, -6.0, 1.5)
    soc = 0.5 + 0.45 * np.sin(np.linspace(0.0, 6.0 * np.pi, N))
    flat = np.zeros(N)
    temperature = np.broadcast_to(temperature_degC, N).astype(float)
    run = to_grid(TimeSeries(np.arange(N, dtype=float), current, flat + 3.7, temperature, name="r"), 1.0)
    simulated = 3.7 - extra_V(soc, current) - rng.normal(0.0, 1e-3, N)
    return RunComparison(run, simulated, soc, np.ones(N, bool) if inside is None else inside)


NETWORK = hand_network.everything(1)  # only its capacity counts


def test_a_planted_region_leads_the_list() -> None:
    c_rate_2 = -2.0 * NETWORK.cell.capacity_Ah
    planted = compared(lambda soc, current: 0.01 * ((soc < 0.2) & (current < min(c_rate_2, -0.1))))
    first = error_map(NETWORK, [planted])["regions"][0]
    assert "SoC below 0.2" in first["text"] and "discharge" in first["text"]
    assert {each["variable"] for each in first["conditions"]} == {"soc", "current_A"}
    share = np.mean((planted.soc < 0.2) & (planted.run.current_A < 0))
    assert first["share_of_time"] == pytest.approx(share, rel=0.1)
    assert first["share_of_squared_error"] > 0.8 and first["rmse_mV"] == pytest.approx(10.0, rel=0.1)


def test_an_even_error_has_no_region() -> None:
    assert error_map(NETWORK, [compared(lambda soc, current: 0.0 * soc)])["regions"] == []


def test_the_map_shows_size_and_sign() -> None:
    found = error_map(NETWORK, [compared(lambda soc, current: np.where(soc < 0.5, -0.008, 0.002))])["maps"][0]
    assert found["x"]["variable"] == "soc" and found["y"]["variable"] == "current_A"
    bias, rmse = np.array(found["bias_mV"]), np.array(found["rmse_mV"])
    assert bias.shape == (len(found["y"]["edges"]) - 1, len(found["x"]["edges"]) - 1) == rmse.shape
    low = np.array(found["x"]["edges"][:-1]) < 0.49
    np.testing.assert_allclose(np.nanmean(bias[:, low]), -8.0, atol=0.3)
    np.testing.assert_allclose(np.nanmean(bias[:, ~low]), 2.0, atol=0.3)
    assert np.nansum(found["share_of_time"]) == pytest.approx(1.0)
    # Currents that never flowed have no error, rather than none.
    assert np.isnan(rmse).any() and None in plain(found)["rmse_mV"][1]


def test_temperature_is_mapped_where_it_moves() -> None:
    cold = np.linspace(0.0, 20.0, N)
    maps = error_map(NETWORK, [compared(lambda soc, current: 0.01 * (cold < 5.0), temperature_degC=cold)])
    assert [each["y"]["variable"] for each in maps["maps"]] == ["current_A", "temperature_degC"]
    assert any("cell below" in each["text"] for each in maps["regions"][:1])
    steady = error_map(NETWORK, [compared(lambda soc, current: 0.0 * soc)])
    assert [each["y"]["variable"] for each in steady["maps"]] == ["current_A"]
    unknown = error_map(NETWORK, [compared(lambda soc, current: 0.0 * soc, temperature_degC=np.nan)])
    json.dumps(plain(unknown), allow_nan=False)


def test_samples_outside_the_trained_domain_are_counted_and_left_out() -> None:
    inside = np.arange(N) >= N // 4
    found = error_map(NETWORK, [compared(lambda soc, current: 0.5 * ~inside, inside=inside)])
    assert found["outside_training"] == pytest.approx(0.25)
    assert np.nanmax(found["maps"][0]["rmse_mV"]) < 2.0 and found["regions"] == []


def profile(found, variable):
    return next(each for each in found["profiles"] if each["variable"] == variable)


def test_profiles_keep_the_directions_apart() -> None:
    # Every second part of the current discharges: a loop of 10 mV that hangs on the direction.
    found = error_map(NETWORK, [compared(lambda soc, current: 0.005 * np.sign(current))])
    over_soc = profile(found, "soc")
    np.testing.assert_allclose(np.nanmean(over_soc["after_charge"]), 5.0, atol=0.3)
    np.testing.assert_allclose(np.nanmean(over_soc["after_discharge"]), -5.0, atol=0.3)
    assert len(over_soc["at"]) == len(over_soc["after_charge"]) == len(over_soc["after_discharge"])
    assert 0.05 <= min(over_soc["at"]) < max(over_soc["at"]) <= 0.95
    assert over_soc["quantity"] == "error_mV"
    assert "soc_at_rest" not in {each["variable"] for each in found["profiles"]}  # it never rested


def test_a_resistance_that_is_missing_shows_over_temperature() -> None:
    cold = np.linspace(0.0, 20.0, N)
    found = error_map(NETWORK, [compared(lambda soc, current: 0.003 * current, temperature_degC=cold)])
    over = profile(found, "temperature_degC")
    assert over["quantity"] == "resistance_mOhm"
    np.testing.assert_allclose(np.nanmean(over["after_discharge"]), 3.0, atol=0.1)


def test_time_since_a_step() -> None:
    rate = np.array([0.0, 0.0, 1.0, 1.0, 1.01, 1.0, 0.0, 0.0])
    np.testing.assert_array_equal(since_step_s(rate, 2.0), [0.0, 2.0, 0.0, 2.0, 4.0, 6.0, 0.0, 2.0])


def test_nothing_to_map_is_said() -> None:
    with pytest.raises(ModelError, match="no run"):
        error_map(NETWORK, [])
