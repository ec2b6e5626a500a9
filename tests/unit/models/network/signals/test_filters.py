import numpy as np
import pytest
from scipy.signal import impulse, lfilter

from models.network.signals import filters


def test_relaxation_is_zero_at_rest_and_dies_out_at_constant_current() -> None:
    current = np.concatenate([np.zeros(10), np.full(5000, -3.0)])
    u = filters.relaxation(current, 100.0, 1.0)
    assert np.all(u[:10] == 0.0)
    assert abs(u[-1]) < 1e-9
    assert u.min() < -0.1


def test_relaxation_matches_the_continuous_filter() -> None:
    tau, dt = 300.0, 0.05
    fast = 0.002 * tau
    t = np.arange(20_000) * dt
    u = filters.relaxation(np.concatenate([[0.0], np.ones(len(t) - 1)]), tau, dt)
    denominator = np.polymul([tau, 1.0], np.polymul([fast, 1.0], [fast, 1.0]))
    _, exact = impulse(([tau], denominator), T=t)
    assert np.abs(u - exact)[int(10 * fast / dt) :].max() < 2e-3
    assert np.abs(u - exact).max() < 0.05  # the edge itself, where the sampling shows


def test_relaxation_does_not_depend_on_sampling_time() -> None:
    fine = filters.relaxation(np.concatenate([[0.0], np.ones(9999)]), 300.0, 0.1)[::10]
    coarse = filters.relaxation(np.concatenate([[0.0], np.ones(999)]), 300.0, 1.0)
    assert np.abs(fine - coarse)[10:].max() < 0.01 * fine.max()


@pytest.mark.parametrize("tau", [5.0, 80.0])
def test_low_pass_reaches_the_current(tau: float) -> None:
    u = filters.low_pass(np.full(4000, 2.0), tau, 1.0)
    assert u[-1] == pytest.approx(2.0, abs=1e-9)
    assert u[int(tau)] == pytest.approx(2.0 * (1 - np.exp(-(int(tau) + 1) / tau)), rel=1e-9)


def test_diffusion_settles_to_its_input_and_keeps_the_charge_that_went_in() -> None:
    step = np.ones(20000)
    settled = filters.diffusion(step, 500.0, np.ones(1), 1.0)
    assert settled[-1] == pytest.approx(1.0, abs=1e-9)
    assert (np.diff(settled) >= 0.0).all()


def test_slower_diffusion_settles_higher_but_begins_alike() -> None:
    # The surface's state of charge: input and time constants both scaled, as a colder cell has it.
    warm = filters.diffusion(np.ones(50000), 500.0, np.ones(1), 1.0)
    cold = filters.diffusion(np.full(50000, 4.0), 500.0, np.full(1, 4.0), 1.0)
    assert cold[-1] == pytest.approx(4.0 * warm[-1], rel=1e-6)
    assert cold[0] == pytest.approx(warm[0], rel=0.05)


def test_diffusion_against_the_series_in_closed_form() -> None:
    # After a step each mode rises as 1 - exp(-t / tau_n); tau_n goes with the inverse square of the root of tan x = x.
    roots = np.array([4.493409458, 7.725251837, 10.904121659])
    assert np.tan(roots) == pytest.approx(roots, rel=1e-6)
    t = np.arange(1, 2001)
    tau = 300.0 * (roots[0] / roots) ** 2
    expected = ((1.0 - np.exp(-t[:, None] / tau)) * roots**-2.0).sum(axis=1) / (roots**-2.0).sum()
    np.testing.assert_allclose(filters.diffusion(np.ones(2000), 300.0, np.ones(1), 1.0), expected, atol=1e-12)


@pytest.mark.parametrize("time_constant_s", [0.3, 20.0, 3e4])
@pytest.mark.parametrize("dt_s", [0.1, 1.0, 10.0])
def test_a_low_pass_is_scipys_to_the_bit(time_constant_s: float, dt_s: float) -> None:
    rng = np.random.default_rng(0)
    values = rng.standard_normal(5000) * rng.choice([0.0, 1.0, 1e-9, 1e6], 5000)
    pole = float(np.exp(-dt_s / time_constant_s))
    expected = lfilter([1.0 - pole], [1.0, -pole], values)
    np.testing.assert_array_equal(filters.low_pass(values, time_constant_s, dt_s), expected)
