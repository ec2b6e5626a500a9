from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.network.free_run import free_run_V
from models.observer import FuzzyObserver, ObserverSettings
from models.observer.tuning.accuracy import soc_figures
from tests.unit.models import synthetic


@pytest.fixture
def observer(fitted: FuzzyObserver) -> FuzzyObserver:
    return fitted


def test_step_by_step_equals_replay_to_the_bit(observer: FuzzyObserver) -> None:
    run = synthetic.run(400, seed=7, noise_V=1e-3)
    _, rows = observer.replay(observer.initial(0.4), run.current_A, run.voltage_V, run.temperature_degC)
    state = observer.initial(0.4)
    for k in range(len(run)):
        state, out = observer.step(state, run.current_A[k], run.voltage_V[k], run.temperature_degC[k])
        assert out.soc == rows[k, 0]
        assert out.soc_std == rows[k, 1]
        assert out.model_voltage_V == rows[k, 2]


def test_a_step_leaves_the_old_state_as_it_was(observer: FuzzyObserver) -> None:
    state = observer.initial(0.4)
    before = state.x.copy()
    observer.step(state, 1.0, 3.7, 25.0)
    np.testing.assert_array_equal(state.x, before)


def test_without_voltage_it_counts_charge_and_follows_the_free_run(observer: FuzzyObserver) -> None:
    run = synthetic.run(1500, seed=7)
    voltage = np.full(len(run), np.nan)
    voltage[0] = run.voltage_V[0]
    # A start that is known this well is not moved by the one measured value.
    _, rows = observer.replay(observer.initial(0.6, 1e-9), run.current_A, voltage, run.temperature_degC)
    assert run.soc_ref is not None
    np.testing.assert_allclose(rows[:, 0], run.soc_ref, atol=1e-9)
    simulated = free_run_V(observer.network, to_grid(run, 1.0), 0.6)
    order = observer.network.structure.output_order
    np.testing.assert_allclose(rows[order:, 2], simulated[order:], atol=2e-3)
    assert rows[-1, 1] > 10.0 * rows[10, 1]


@pytest.mark.parametrize("offset", [-0.2, 0.2])
def test_it_finds_the_state_of_charge_from_far_off(observer: FuzzyObserver, offset: float) -> None:
    run = synthetic.run(4000, seed=11, noise_V=1e-3)
    _, rows = observer.replay(observer.initial(0.6 + offset), run.current_A, run.voltage_V, run.temperature_degC)
    figures = soc_figures(run.time_s, rows[:, 0], rows[:, 1], run.soc_ref)
    assert figures["converged_after_s"] is not None
    assert figures["soc_rmse"] is not None and figures["soc_rmse"] < 0.01


def test_beyond_the_trained_temperatures_it_claims_less_the_farther_it_goes(observer: FuzzyObserver) -> None:
    """There a network is off by more than where it was trained; whatever is read, the voltage is believed less."""
    run = synthetic.run(1500, seed=7, noise_V=1e-3)
    low, high = observer.network.record.domain["temperature_degC"]
    std = {}
    for name, temperature in (
        ("at the edge", high),
        ("warmer", high + 8.0),
        ("hot", high + 20.0),
        ("cold", low - 20.0),
    ):
        everywhere = np.full(len(run), temperature)
        state, rows = observer.replay(observer.initial(0.6, 0.02), run.current_A, run.voltage_V, everywhere)
        assert np.isfinite(rows[-1, :5]).all()
        assert np.isfinite(state.covariance).all()
        std[name] = rows[-1, 1]
    assert 1.2 * std["at the edge"] < std["warmer"] < std["hot"]
    assert std["cold"] > 1.2 * std["at the edge"]


def test_it_coasts_through_missing_samples(observer: FuzzyObserver) -> None:
    run = synthetic.run(2000, seed=11, noise_V=1e-3)
    voltage, temperature = run.voltage_V.copy(), run.temperature_degC.copy()
    voltage[800:1000] = np.nan
    temperature[600:900] = np.nan
    counting = FuzzyObserver(observer.network, replace(observer.settings, capacity_std=0.0, current_offset_std_C=0.0))
    for observing in (observer, counting):
        _, rows = observing.replay(observing.initial(0.6), run.current_A, voltage, temperature)
        _, seeing = observing.replay(observing.initial(0.6), run.current_A, run.voltage_V, temperature)
        assert np.isfinite(rows[:, :3]).all()
        assert np.isnan(rows[800:1000, 3]).all()
        assert rows[999, 1] > seeing[999, 1]
        assert run.soc_ref is not None
        assert abs(rows[-1, 0] - run.soc_ref[-1]) < 0.02
    assert (np.diff(rows[800:1000, 1]) > 0.0).all()


def test_the_estimate_stays_near_empty_and_full_whatever_is_measured(observer: FuzzyObserver) -> None:
    n = 3000
    for voltage, current in ((2.0, -8.0), (5.0, 8.0)):
        arrays = (np.full(n, current), np.full(n, voltage), np.full(n, 25.0))
        _, rows = observer.replay(observer.initial(0.5), *arrays)
        assert rows[:, 0].min() >= -0.051 and rows[:, 0].max() <= 1.051


@pytest.mark.parametrize("bad", [{"voltage_std_V": 0.0}, {"voltage_std_V": float("nan")}, {"nonsense": 1.0}])
def test_bad_settings_are_refused(bad: dict) -> None:
    with pytest.raises(ModelError, match="observer settings"):
        ObserverSettings.from_json(ObserverSettings().to_json() | bad)


def test_figures_count_from_convergence() -> None:
    time_s = np.arange(10.0)
    reference = np.full(10, 0.5)
    soc = reference + np.array([0.2, 0.1, 0.05, 0.02, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01])
    figures = soc_figures(time_s, soc, np.full(10, 0.015), reference)
    assert figures["converged_after_s"] == 3.0
    assert figures["soc_max_error"] == pytest.approx(0.02)
    assert figures["coverage_95"] == 1.0
    assert figures["soc_end_error"] == pytest.approx(0.01)


def test_figures_say_when_it_never_converged() -> None:
    figures = soc_figures(np.arange(5.0), np.full(5, 0.9), np.full(5, 0.01), np.full(5, 0.5))
    assert figures["converged_after_s"] is None
    assert figures["soc_rmse"] == pytest.approx(0.4)
    assert set(soc_figures(np.arange(5.0), np.ones(5), np.ones(5), None).values()) == {None}
