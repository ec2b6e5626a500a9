"""Full and empty, and samples that fit badly."""

from dataclasses import replace

import numpy as np

from models.observer import FuzzyObserver
from models.observer.filter.places import SOC_SLACK
from tests.unit.models import hand_network, synthetic
from tests.unit.models.observer.filter.test_kalman import OHM, SETTINGS, SLOPE, one_line


def test_a_full_cell_whose_voltage_is_too_high_is_full_and_the_model_wrong() -> None:
    n = 1500
    observer = FuzzyObserver(one_line(0.7), replace(SETTINGS, current_offset_std_C=0.005))
    current = np.where(np.arange(n) < 1000, 0.0, -2.0)
    counted = 1.0 + SOC_SLACK + np.cumsum(current) / (3600.0 * hand_network.CAPACITY_AH)
    volts = 3.2 + SLOPE * counted + OHM * current + 0.02
    state, rows = observer.replay(observer.initial(1.0, 0.02), current, volts, np.full(n, 25.0))
    assert rows[:, 0].max() <= 1.0 + SOC_SLACK + 1e-12
    # What the voltage says beyond full has become error of the model, so that it does not press any more.
    assert np.abs(rows[900:1000, 3]).max() < 0.002
    assert rows[999, 10] > 1.0
    # Nor is the current sensor blamed.
    assert abs(rows[999, 5]) < 2.0 * 0.005 * hand_network.CAPACITY_AH
    assert abs(rows[-1, 0] - counted[-1]) < 0.02
    assert state.weight[0] == 1.0


def test_one_bad_sample_after_the_start_does_not_end_what_is_true(fitted: FuzzyObserver) -> None:
    run = synthetic.run(2000, seed=11, noise_V=1e-3)
    voltage = run.voltage_V.copy()
    voltage[1] -= 0.2
    _, rows = fitted.replay(fitted.initial(0.4), run.current_A, voltage, run.temperature_degC)
    assert run.soc_ref is not None
    assert np.abs(rows[1000:, 0] - run.soc_ref[1000:]).max() < 0.02


def test_hypotheses_that_are_left_stand_first(fitted: FuzzyObserver) -> None:
    run = synthetic.run(50, seed=11, noise_V=1e-3)
    state = fitted.initial(0.4)
    for k in range(50):
        state, out = fitted.step(state, run.current_A[k], run.voltage_V[k], run.temperature_degC[k])
        left = int((state.weight > 0.0).sum())
        assert (state.weight[:left] > 0.0).all() and not state.weight[left:].any()
        assert abs(state.weight.sum() - 1.0) < 1e-12
        assert out.hypotheses == left
        for covariance in state.covariance[:left]:
            np.testing.assert_array_equal(covariance, covariance.T)
