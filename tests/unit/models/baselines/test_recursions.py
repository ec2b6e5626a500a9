import numpy as np

from models.baselines.recursions import branch_drive, direction, hysteresis_drive, log_rate_gradient, state
from models.baselines.tables import locate
from tests.unit.models.baselines.circuits import branch_V, hysteresis
from tests.unit.models.synthetic import excitation_A

ONE_PART = np.zeros(1, dtype=np.int64)
KNOTS = np.array([0.0, 20.0, 30.0])


def constant_temperature(n: int):
    return locate(np.array([25.0]), np.full(n, 25.0))


def test_hysteresis_follows_its_analytic_solution_at_constant_current() -> None:
    n, gamma, capacity_Ah = 400, 30.0, 2.5
    current = np.where(np.arange(n) < 250, -4.0, 1.5)
    current[0] = 0.0
    h = state(hysteresis_drive(current, 1.0, capacity_Ah, 0.01, ONE_PART), np.log([gamma]), constant_temperature(n))
    t = np.arange(n)
    down = -1.0 + np.exp(-gamma * 4.0 * t[:250] / (3600.0 * capacity_Ah))
    np.testing.assert_allclose(h[:250], down, atol=1e-12)
    up = 1.0 + (h[249] - 1.0) * np.exp(-gamma * 1.5 * (t[250:] - 249) / (3600.0 * capacity_Ah))
    np.testing.assert_allclose(h[250:], up, atol=1e-12)


def test_hysteresis_stays_at_rest_and_within_its_loop() -> None:
    rng = np.random.default_rng(1)
    current = excitation_A(3000, rng, 50.0)
    h = state(hysteresis_drive(current, 1.0, 1.0, 0.005, ONE_PART), np.log([200.0]), constant_temperature(3000))
    assert np.abs(h).max() <= 1.0
    resting = np.flatnonzero(current[1:] == 0.0) + 1
    np.testing.assert_array_equal(h[resting], h[resting - 1])
    expected, _ = hysteresis(np.concatenate([[0.0], current[1:]]), 200.0)
    np.testing.assert_allclose(h, expected, atol=1e-12)


def test_a_branch_adds_up_step_responses() -> None:
    current = excitation_A(1200, np.random.default_rng(2))
    current[0] = 0.0
    x = state(branch_drive(current, 1.0, ONE_PART), np.array([-np.log(17.0)]), constant_temperature(1200))
    np.testing.assert_allclose(x, branch_V(current, 1.0, 17.0), atol=1e-11)


def test_each_part_begins_at_rest() -> None:
    current = np.full(60, 3.0)
    x = state(branch_drive(current, 1.0, np.array([0, 40])), np.array([-np.log(10.0)]), constant_temperature(60))
    assert x[40] == 0.0
    np.testing.assert_allclose(x[40:], x[:20])


def test_direction_is_held_and_begins_unknown_in_each_part() -> None:
    current = np.array([0.0, 2.0, 0.0, -1.0, 0.0, 0.0, 1.0])
    np.testing.assert_array_equal(direction(current, 0.01, np.array([0, 5])), [0, 1, 1, -1, -1, 0, 1])


def test_gradient_is_the_derivative_of_the_recursion() -> None:
    rng = np.random.default_rng(3)
    current, n = excitation_A(700, rng), 700
    temperature = locate(KNOTS, rng.uniform(-5.0, 35.0, n))
    starts = np.array([0, 300])
    weight = rng.normal(size=n)
    drives = (branch_drive(current, 1.0, starts), hysteresis_drive(current, 1.0, 0.05, 0.01, starts))
    for drive, theta in zip(drives, (-np.log([3.0, 9.0, 40.0]), np.log([3.0, 10.0, 20.0])), strict=True):
        exact = log_rate_gradient(drive, theta, temperature, state(drive, theta, temperature), weight)
        for i in range(3):
            moved = np.eye(3)[i] * 1e-6
            ends = [weight @ state(drive, theta + sign * moved, temperature) for sign in (1.0, -1.0)]
            np.testing.assert_allclose(exact[i], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-7)
