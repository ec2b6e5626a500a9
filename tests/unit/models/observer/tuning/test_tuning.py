from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer import FuzzyObserver, default_settings
from models.observer.filter.settings import ObserverSettings
from models.observer.tuning.innovations import log_likelihood, tuning_data
from models.observer.tuning.tuning import most_likely, tune, with_tuned_observer
from models.observer.tuning.unseen import as_they_are
from tests.unit.models import hand_network


def network() -> LocalModelNetwork:
    structure = Structure(
        0, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc"),), hand_network.DT_S
    )
    return hand_network.network(structure, np.array([[0.7, 0.02, 3.3]]))


def measured(seed: int, noise_V: float, error_V: float, error_s: float, n: int = 6000) -> TimeSeries:
    """The network's own voltage with white noise and a first-order error of known size and time constant."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.normal(0.0, 1.0, n // 20), 20)
    current[0] = 0.0
    soc = 0.5 + np.cumsum(current) / (3600.0 * hand_network.CAPACITY_AH)
    keep = np.exp(-1.0 / error_s)
    error = np.zeros(n)
    for k in range(1, n):
        error[k] = keep * error[k - 1] + error_V * np.sqrt(1.0 - keep**2) * rng.standard_normal()
    before = np.concatenate([[0.5], soc[:-1]])
    volts = 3.3 + 0.7 * before + 0.02 * current + error + noise_V * rng.standard_normal(n)
    return TimeSeries(np.arange(n) * 1.0, current, volts, np.full(n, 25.0), None, soc)


def test_noise_and_quick_error_are_found_again() -> None:
    data = tuning_data(as_they_are(network(), [to_grid(measured(1, 1e-3, 3e-3, 20.0), 1.0)], [0.5]))
    found = most_likely(data, ObserverSettings(slow_error_std_V=2e-3, slow_error_time_s=3e4, soc_std_per_sqrt_s=1e-6))
    assert 0.85e-3 < found.voltage_std_V < 1.15e-3
    assert 2e-3 < found.quick_error_std_V < 4.5e-3
    assert 8.0 < found.quick_error_time_s < 50.0


def test_what_was_found_is_more_likely_than_its_neighbours() -> None:
    run = measured(2, 2e-3, 2e-3, 40.0)
    data = tuning_data(as_they_are(network(), [to_grid(run, 1.0)], [0.5]))
    truth = np.array([2e-3, 2e-3, 40.0, 2e-4, 3e4, 0.1, 1e-6, 1e-3])
    best = log_likelihood(data, truth)
    for place in range(3):
        for factor in (0.4, 2.5):
            other = truth.copy()
            other[place] *= factor
            assert log_likelihood(data, other) < best


def test_settings_that_were_tuned_are_used_from_the_models_record() -> None:
    model = network()
    found = tune(model, [measured(1, 1e-3, 3e-3, 20.0, 2000)], [0.5])
    model = replace(model, record=replace(model.record, observer=found.to_json()))
    assert default_settings(model) == found
    assert FuzzyObserver(model).settings == found


def test_the_band_holds_about_as_often_as_it_says() -> None:
    model = network()
    runs = [measured(seed, 1e-3, 3e-3, 30.0) for seed in range(3)]
    settings = tune(model, runs, [0.5] * 3)
    inside = []
    for seed in range(10, 16):
        run = measured(seed, 1e-3, 3e-3, 30.0)
        observer = FuzzyObserver(model, settings)
        _, rows = observer.replay(observer.initial(0.7), run.current_A, run.voltage_V, run.temperature_degC)
        assert run.soc_ref is not None
        inside.append(np.abs(rows[1000:, 0] - run.soc_ref[1000:]) <= 1.96 * rows[1000:, 1])
    assert 0.8 < float(np.mean(inside)) <= 1.0


@pytest.mark.proof
def test_a_network_that_no_observer_can_use_says_so() -> None:
    structure = Structure(0, (InputChannel("current"),), (PartitionAxis("current"),), hand_network.DT_S)
    blind = hand_network.network(structure, np.array([[0.02, 3.3]]))
    found = with_tuned_observer(blind, [measured(1, 1e-3, 3e-3, 20.0, 2000)], [0.5]).record
    assert found.observer is None and "observer" not in found.to_json()
    assert "this model has none" in found.reservations[-1]
    seeing = with_tuned_observer(network(), [measured(1, 1e-3, 3e-3, 20.0, 2000)], [0.5])
    assert default_settings(seeing).to_json() == seeing.record.observer
