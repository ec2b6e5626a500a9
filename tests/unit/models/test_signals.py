import numpy as np
import pytest
from scipy.signal import impulse

from models import signals


def test_relaxation_is_zero_at_rest_and_dies_out_at_constant_current() -> None:
    current = np.concatenate([np.zeros(10), np.full(5000, -3.0)])
    u = signals.relaxation(current, 100.0, 1.0)
    assert np.all(u[:10] == 0.0)
    assert abs(u[-1]) < 1e-9
    assert u.min() < -0.1


def test_relaxation_matches_the_continuous_filter() -> None:
    tau, dt = 300.0, 0.05
    fast = 0.002 * tau
    t = np.arange(20_000) * dt
    u = signals.relaxation(np.concatenate([[0.0], np.ones(len(t) - 1)]), tau, dt)
    denominator = np.polymul([tau, 1.0], np.polymul([fast, 1.0], [fast, 1.0]))
    _, exact = impulse(([tau], denominator), T=t)
    assert np.abs(u - exact)[int(10 * fast / dt) :].max() < 2e-3
    assert np.abs(u - exact).max() < 0.05  # the edge itself, where the sampling shows


def test_relaxation_does_not_depend_on_sampling_time() -> None:
    fine = signals.relaxation(np.concatenate([[0.0], np.ones(9999)]), 300.0, 0.1)[::10]
    coarse = signals.relaxation(np.concatenate([[0.0], np.ones(999)]), 300.0, 1.0)
    assert np.abs(fine - coarse)[10:].max() < 0.01 * fine.max()


def test_sign_is_held_through_rests() -> None:
    current = np.array([0.0, 0.001, -2.0, 0.0, 0.0, 1.0, 0.0, -1.0])
    np.testing.assert_array_equal(signals.held_sign(current, 0.01), [-1, -1, -1, -1, -1, 1, 1, -1])


def test_soc_counts_charge_and_applies_efficiency_to_charging_only() -> None:
    charge = np.array([0.0, 1.0, 0.5])
    np.testing.assert_allclose(signals.soc_by_counting(charge, 0.2, 2.0), [0.2, 0.7, 0.45])
    np.testing.assert_allclose(signals.soc_by_counting(charge, 0.2, 2.0, 0.9), [0.2, 0.65, 0.4])


@pytest.mark.parametrize("tau", [5.0, 80.0])
def test_low_pass_reaches_the_current(tau: float) -> None:
    u = signals.low_pass(np.full(4000, 2.0), tau, 1.0)
    assert u[-1] == pytest.approx(2.0, abs=1e-9)
    assert u[int(tau)] == pytest.approx(2.0 * (1 - np.exp(-(int(tau) + 1) / tau)), rel=1e-9)
