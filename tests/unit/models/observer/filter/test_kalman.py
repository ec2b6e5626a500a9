"""The compiled step against plain formulas written here."""

from dataclasses import replace

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


@pytest.mark.parametrize(
    ("missing", "offset_std_C"), [(slice(0), 0.0), (slice(0), 0.01), (slice(20, 400), 0.01), (slice(20, 60), 0.0)]
)
def test_one_local_model_is_a_plain_kalman_filter(missing: slice, offset_std_C: float) -> None:
    past, n, s = 0.7, 500 if missing.stop else 60, replace(SETTINGS, current_offset_std_C=offset_std_C)
    rng = np.random.default_rng(5)
    current = rng.normal(0.0, 2.0, n)
    current[missing] = np.nan
    volts = 3.6 + 0.05 * rng.standard_normal(n)
    observer = FuzzyObserver(one_line(past), s)
    _, rows = observer.replay(observer.initial(0.5, 0.02), current, volts, np.full(n, 25.0))

    # State in volts: [V, SoC, quick, slow, current offset, capacity error, voltage offset, resistance error].
    one_C = hand_network.CAPACITY_AH
    per_A = hand_network.DT_S / (3600.0 * hand_network.CAPACITY_AH)
    low, high = hand_network.SCALING["voltage"]
    x = np.array([volts[0], 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    starts = (s.voltage_std_V, 0.02, 1.0, 1.0, offset_std_C * one_C, s.capacity_std, s.voltage_offset_std_V, 1.0)
    p, net, held_A, lost, left, told = np.diag(np.square(starts)), 0.0, current[0], 0, 0.0, 0
    for k in range(1, n):
        lost = lost + 1 if np.isnan(current[k]) else 0
        if lost > 1:
            left += (1.0 - left) / 600.0
        elif lost == 0:
            left *= 1.0 - 1.0 / 600.0
            left = left if left >= 0.01 else 0.0
            held_A = current[k]
        moved = per_A * held_A
        net += (moved - net) / 600.0
        quick = np.exp(-1.0 / s.quick_error_time_s)
        slow = np.exp(-1.0 / s.slow_error_time_s - abs(net) / s.slow_error_soc)
        a = np.diag([past, 1.0, quick, slow, 1.0, 1.0, 1.0, slow])
        a[0, 1], a[1, 5] = (1.0 - past) * SLOPE, moved
        if offset_std_C > 0.0:
            a[0, 4], a[1, 4] = -(1.0 - past) * OHM, -per_A
        given = np.array([(1.0 - past) * (3.2 + OHM * held_A), moved, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        x, p = a @ x + given, a @ p @ a.T
        q_soc = s.soc_std_per_sqrt_s**2 + (lost**2 - max(lost - 1, 0) ** 2) * (per_A * one_C) ** 2
        p += np.diag([0.0, q_soc, 1.0 - quick**2, 1.0 - slow**2, 0.0, 0.0, 0.0, 1.0 - slow**2])
        c = np.array(
            [1.0, 0.0, s.quick_error_std_V, s.slow_error_std_V, 0.0, 0.0, 1.0, s.resistance_std * OHM * held_A]
        )
        variance = c @ p @ c + s.voltage_std_V**2
        # What is told of a voltage whose error is that of an unknown current, alike in all samples.
        blind = ((1.0 if lost else left) * (one_C * OHM if offset_std_C > 0.0 else high - low)) ** 2
        innovation = volts[k] - c @ x
        assert rows[k, 3] == pytest.approx(innovation, abs=1e-12)
        assert rows[k, 4] == pytest.approx(np.sqrt(variance + blind), rel=1e-10)
        if variance > blind:
            total = variance**2 / (variance - blind)
            gain = p @ c / total
            if blind > 0.0:
                gain[4:] = 0.0
                told += 1
            x = x + gain * innovation
            p = p - np.outer(gain, p @ c) - np.outer(p @ c, gain) + np.outer(gain, gain) * total
        assert rows[k, 0] == pytest.approx(x[1], abs=1e-11)
        assert rows[k, 1] == pytest.approx(np.sqrt(p[1, 1]), rel=1e-9)
        assert rows[k, 5] == pytest.approx(x[4], abs=1e-11)
    assert told > 50 or missing.stop != 400


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
