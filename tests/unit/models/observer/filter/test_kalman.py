"""The compiled step against plain formulas written here."""

import numpy as np
import pytest

from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer import FuzzyObserver, ObserverSettings
from tests.unit.models import hand_network

SETTINGS = ObserverSettings(
    voltage_std_V=2e-3,
    quick_error_std_V=3e-3,
    quick_error_time_s=15.0,
    slow_error_std_V=4e-3,
    slow_error_time_s=2000.0,
    slow_error_soc=0.1,
    resistance_std=0.05,
    soc_std_per_sqrt_s=1e-4,
    current_offset_std_C=0.0,
    capacity_std=0.01,
    voltage_offset_std_V=1e-3,
)
SLOPE, OHM = 0.8, 0.03


def one_line(past: float) -> LocalModelNetwork:
    """A single local model: V = past V(k-1) + (1 - past) (3.2 + 0.8 SoC + 0.03 I)."""
    structure = Structure(
        1, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc"),), hand_network.DT_S
    )
    left = 1.0 - past
    return hand_network.network(structure, np.array([[past, left * SLOPE, left * OHM, left * 3.2]]))


def test_one_local_model_is_a_plain_kalman_filter() -> None:
    past, s = 0.7, SETTINGS
    rng = np.random.default_rng(5)
    current = rng.normal(0.0, 2.0, 60)
    volts = 3.6 + 0.05 * rng.standard_normal(60)
    observer = FuzzyObserver(one_line(past), s)
    _, rows = observer.replay(observer.initial(0.5, 0.02), current, volts, np.full(60, 25.0))

    # State in volts: [V, SoC, quick, slow, capacity error, voltage offset, resistance error].
    per_A = hand_network.DT_S / (3600.0 * hand_network.CAPACITY_AH)
    x = np.array([volts[0], 0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    p = np.diag([s.voltage_std_V**2, 0.02**2, 1.0, 1.0, s.capacity_std**2, s.voltage_offset_std_V**2, 1.0])
    net = 0.0
    for k in range(1, 60):
        moved = per_A * current[k]
        net += (moved - net) / 600.0
        quick = np.exp(-1.0 / s.quick_error_time_s)
        slow = np.exp(-1.0 / s.slow_error_time_s - abs(net) / s.slow_error_soc)
        a = np.diag([past, 1.0, quick, slow, 1.0, 1.0, slow])
        a[0, 1], a[1, 4] = (1.0 - past) * SLOPE, moved
        given = np.array([(1.0 - past) * (3.2 + OHM * current[k]), moved, 0.0, 0.0, 0.0, 0.0, 0.0])
        x, p = a @ x + given, a @ p @ a.T
        p += np.diag([0.0, s.soc_std_per_sqrt_s**2, 1.0 - quick**2, 1.0 - slow**2, 0.0, 0.0, 1.0 - slow**2])
        c = np.array([1.0, 0.0, s.quick_error_std_V, s.slow_error_std_V, 0.0, 1.0, s.resistance_std * OHM * current[k]])
        variance = c @ p @ c + s.voltage_std_V**2
        innovation = volts[k] - c @ x
        assert rows[k, 3] == pytest.approx(innovation, abs=1e-12)
        assert rows[k, 4] == pytest.approx(np.sqrt(variance), rel=1e-10)
        gain = p @ c / variance
        x, p = x + gain * innovation, p - np.outer(gain, gain) * variance
        assert rows[k, 0] == pytest.approx(x[1], abs=1e-12)
        assert rows[k, 1] == pytest.approx(np.sqrt(p[1, 1]), rel=1e-9)


def test_the_gain_follows_the_slope_of_the_blend_not_of_the_local_parameters() -> None:
    # Two level lines: each local model by itself is flat, the blend climbs from one to the other.
    structure = Structure(
        0,
        (InputChannel("soc", delay=1), InputChannel("current")),
        (PartitionAxis("soc", initial=2, k_sigma=0.3),),
        hand_network.DT_S,
    )
    observer = FuzzyObserver(hand_network.network(structure, np.array([[0.0, 0.02, 3.2], [0.0, 0.02, 3.8]])))

    def expected_V(soc: float) -> float:
        return observer.step(observer.initial(soc, 1e-9), 0.0, np.nan, 25.0)[1].model_voltage_V

    slope = (expected_V(0.501) - expected_V(0.499)) / 0.002
    assert slope > 1.0
    _, out = observer.step(observer.initial(0.5, 0.01), 0.0, expected_V(0.5) + 0.01, 25.0)
    s = observer.settings
    error = s.voltage_std_V**2 + s.quick_error_std_V**2 + s.slow_error_std_V**2
    gain = slope * 0.01**2 / (slope**2 * 0.01**2 + error)
    assert out.soc - 0.5 == pytest.approx(gain * 0.01, rel=1e-3)


def test_charge_is_counted_where_the_curve_is_flat() -> None:
    structure = Structure(
        0, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc"),), hand_network.DT_S
    )
    observer = FuzzyObserver(hand_network.network(structure, np.array([[1e-6, 0.02, 3.3]])))
    n = 500
    _, rows = observer.replay(observer.initial(0.5, 0.02), np.full(n, -1.0), np.full(n, 3.4), np.full(n, 25.0))
    counted = 0.5 - np.arange(n) / (3600.0 * hand_network.CAPACITY_AH)
    np.testing.assert_allclose(rows[:, 0], counted, atol=2e-4)
    assert rows[-1, 1] >= 0.02
