import numpy as np

from models.network.signals.direction import held_sign, hysteresis_state


def test_sign_is_held_through_rests() -> None:
    current = np.array([0.0, 0.001, -2.0, 0.0, 0.0, 1.0, 0.0, -1.0])
    np.testing.assert_array_equal(held_sign(current, 0.01), [-1, -1, -1, -1, -1, 1, 1, -1])


def test_hysteresis_state_follows_the_charge_and_not_the_time() -> None:
    # 36 As of 1 Ah are 1 % of the capacity, whether they flow at once or slowly.
    quick = hysteresis_state(np.full(1, 36.0), 40.0, 1.0, 1.0)
    slow = hysteresis_state(np.full(10, 3.6), 40.0, 1.0, 1.0)
    np.testing.assert_allclose([quick[-1], slow[-1]], 1.0 - np.exp(-0.4), rtol=1e-12)
    assert (hysteresis_state(np.zeros(5), 40.0, 1.0, 1.0) == 0.0).all()
