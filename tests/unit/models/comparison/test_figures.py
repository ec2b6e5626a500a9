from dataclasses import replace

import numpy as np
import pytest

from models.comparison.figures import compare
from models.comparison.simulated_runs import simulate_runs
from models.data.errors import ModelError
from models.data.metrics import metrics, noise_floor_V
from models.data.timeseries import TimeSeries
from models.network.model_record import ModelRecord
from models.pipeline.fit import fit_network
from tests.unit.models import synthetic


def test_metrics_of_known_errors() -> None:
    measured = np.array([3.0, 3.1, 3.2, np.nan])
    figures = metrics(measured, np.array([3.001, 3.098, 3.2, 5.0]))
    assert figures["n_samples"] == 3
    assert figures["rmse_mV"] == pytest.approx(np.sqrt(5 / 3))
    assert figures["max_mV"] == pytest.approx(2.0)
    assert figures["bias_mV"] == pytest.approx(1 / 3)
    assert figures["nrmse"] == pytest.approx(np.sqrt(5 / 3) / 200)


@pytest.mark.parametrize("sigma_V", [2e-4, 1e-3, 5e-3])
def test_noise_floor_is_found_under_a_drifting_voltage_with_steps(sigma_V: float) -> None:
    rng = np.random.default_rng(8)
    n = 5000
    current = np.repeat(rng.normal(size=n // 50), 50)
    voltage = 3.5 + 1e-5 * np.arange(n) + 0.02 * current + sigma_V * rng.standard_normal(n)
    assert noise_floor_V(voltage, current) == pytest.approx(sigma_V, rel=0.1)


@pytest.fixture(scope="module")
def network():
    run = synthetic.run(4000, seed=2, noise_V=1e-3)
    return fit_network([run], capacity_Ah=synthetic.CAPACITY_AH, structure="minimal").network


def test_shares_add_up_within_each_variable(network) -> None:
    result = compare(network, [synthetic.run(2000, seed=5, noise_V=1e-3)], [0.6])
    one_by_one = ("soc", "current_A", "direction", "since_step_s", "throughput_Ah", "time_h", "temperature_degC")
    assert {row["variable"] for row in result["where"]} == set(one_by_one)
    for variable in one_by_one:
        rows = [row for row in result["where"] if row["variable"] == variable]
        assert sum(row["share_of_squared_error"] for row in rows) == pytest.approx(1.0)
        assert sum(row["share_of_time"] for row in rows) == pytest.approx(1.0)


def test_a_local_error_is_named_first(network) -> None:
    run = synthetic.run(3000, seed=5)
    wrong = run.voltage_V + np.where(run.current_A > 2.5, 0.03, 0.0)
    hidden = TimeSeries(run.time_s, run.current_A, wrong, run.temperature_degC, None, run.soc_ref)
    result = compare(network, [hidden], [0.6])
    worst = result["where"][0]
    assert worst["variable"] == "current_A"
    assert worst["from"] >= 2.0
    assert "charge above" in result["regions"][0]["text"]
    assert result["regions"][0]["share_of_squared_error"] > 2.0 * result["regions"][0]["share_of_time"]


def test_samples_outside_the_trained_domain_are_counted(network) -> None:
    run = synthetic.run(1000, seed=5)
    hot = TimeSeries(run.time_s, run.current_A, run.voltage_V, run.temperature_degC + 30, None, run.soc_ref)
    assert compare(network, [hot], [0.6])["outside_training"] == 1.0
    assert not simulate_runs(network, [hot], [0.6])[0].inside.any()


def test_what_to_expect_of_runs_does_not_look_at_their_voltage(network) -> None:
    run = synthetic.run(4000, seed=2, noise_V=1e-3)
    result = compare(network, [run], [0.6])
    assert result["overall"]["rmse_mV"] < result["expected_rmse_mV"] < 2.0 * result["overall"]["rmse_mV"]
    wrong = TimeSeries(run.time_s, run.current_A, run.voltage_V + 0.05, run.temperature_degC, None, run.soc_ref)
    assert compare(network, [wrong], [0.6])["expected_rmse_mV"] == pytest.approx(result["expected_rmse_mV"], rel=0.05)


def test_no_run_is_refused(network) -> None:
    with pytest.raises(ModelError, match="no run"):
        compare(network, [], [])


def test_a_model_that_gives_no_voltage_does_not_look_perfect(network) -> None:
    run = synthetic.run(500, seed=5)
    broken = replace(network, theta=np.full_like(network.theta, np.nan))
    with pytest.raises(ModelError, match="gives no voltage"):
        compare(broken, [run], [0.6])
    blind = TimeSeries(run.time_s, run.current_A, np.full(500, np.nan), run.temperature_degC)
    with pytest.raises(ModelError, match="samples have a voltage"):
        compare(network, [blind], [0.6])


def test_what_lies_outside_is_told_by_dimension(network) -> None:
    run = synthetic.run(1000, seed=5)
    half = np.where(np.arange(1000) < 500, 30.0, 0.0)
    warm = TimeSeries(run.time_s, run.current_A, run.voltage_V, run.temperature_degC + half, None, run.soc_ref)
    result = compare(network, [warm], [0.6])
    assert result["outside_by"]["temperature_degC"] == pytest.approx(0.5, abs=0.01)
    assert result["outside_by"]["current_A"] == 0.0
    assert result["outside_training"] >= max(result["outside_by"].values())
    # What the model only guesses at is kept apart, and does not tell where the model is off.
    parts = result["inside_training"], result["outside"]
    assert sum(part["n_samples"] for part in parts) == result["overall"]["n_samples"]
    hottest = max(row["to"] for row in result["where"] if row["variable"] == "temperature_degC")
    assert hottest < run.temperature_degC.max() + 5.0


def test_gaps_are_reported(network) -> None:
    run = synthetic.run(1000, seed=5)
    voltage = run.voltage_V.copy()
    voltage[100:150] = voltage[300:310] = np.nan
    holed = TimeSeries(run.time_s, run.current_A, voltage, run.temperature_degC, None, run.soc_ref)
    (said,) = compare(network, [holed], [0.6])["gaps"]
    assert said["gaps"] == 2 and said["longest_gap_s"] == pytest.approx(50.0, abs=2.0)
    assert said["missing_share"] == pytest.approx(0.06, abs=0.01) and said["parts"] == 1


def test_the_band_is_judged(network) -> None:
    run = synthetic.run(2000, seed=5, noise_V=1e-3)
    band = compare(network, [run], [0.6])["band"]
    assert 0.9 <= band["coverage_95"] <= 1.0
    wrong = TimeSeries(run.time_s, run.current_A, run.voltage_V + 0.1, run.temperature_degC, None, run.soc_ref)
    assert compare(network, [wrong], [0.6])["band"]["coverage_95"] < 0.05
    assert compare(replace(network, record=ModelRecord()), [run], [0.6])["band"] is None
