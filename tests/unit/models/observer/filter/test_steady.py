"""Steady-state gains where sensors and capacity are not known exactly."""

from dataclasses import replace

import numpy as np
import pytest

from models.observer import FuzzyObserver, ObserverSettings
from models.observer.filter.gains import observer_matrices, output_rows, steady_state_gains
from models.observer.filter.steady import designed_gains
from tests.unit.models.observer.filter.test_gains import network

EXACT = ObserverSettings(
    quick_error_std_V=2e-3,
    slow_error_std_V=2e-3,
    slow_error_time_s=600.0,
    resistance_std=0.0,
    soc_std_per_sqrt_s=1e-5,
    current_offset_std_C=0.0,
    capacity_std=0.0,
    gain="steady",
)
UNSURE = replace(EXACT, current_offset_std_C=0.02, capacity_std=0.02, voltage_offset_std_V=1e-3)
MODEL = network(1)
SPAN_V = MODEL.voltage_span_V


def variances(settings: ObserverSettings) -> np.ndarray:
    return designed_gains(MODEL, settings)[:, -1]


def test_with_exact_sensors_they_are_those_of_the_riccati_equation() -> None:
    matrices, process = observer_matrices(MODEL, EXACT)
    rows = output_rows(MODEL, EXACT, np.ones(2))
    plain = steady_state_gains(matrices, rows, process, (EXACT.voltage_std_V / SPAN_V) ** 2)
    np.testing.assert_allclose(designed_gains(MODEL, EXACT), plain, rtol=1e-6)


def test_what_may_be_wrong_makes_them_larger_and_their_error_too() -> None:
    at_soc = 1
    assert (designed_gains(MODEL, UNSURE)[:, at_soc] > 1.5 * designed_gains(MODEL, EXACT)[:, at_soc]).all()
    assert (variances(UNSURE) > variances(EXACT)).all()


def test_the_variance_is_that_of_the_error_after_a_long_time() -> None:
    # Noise as a recursion of covariances, each lasting error as a recursion of means: no closed form is used.
    matrices, process = observer_matrices(MODEL, UNSURE)
    rows = output_rows(MODEL, UNSURE, np.ones(2))
    noise = (UNSURE.voltage_std_V / SPAN_V) ** 2
    size, at_soc = len(rows[0]), 1
    for matrix, row, designed in zip(matrices, rows, designed_gains(MODEL, UNSURE), strict=True):
        gain, covariance, means = designed[:-1], np.eye(size) * 1e-4, np.zeros((3, size))
        for _ in range(40_000):
            covariance = matrix @ covariance @ matrix.T + process
            left = np.eye(size) - np.outer(gain, row)
            covariance = left @ covariance @ left.T + noise * np.outer(gain, gain)
            means = means @ matrix.T
            means[0, at_soc] += MODEL.dt_s / 3600.0 * UNSURE.current_offset_std_C
            means[1, at_soc] += MODEL.dt_s / 3600.0 * 0.5 * UNSURE.capacity_std
            seen = means @ row
            seen[2] -= UNSURE.voltage_offset_std_V / SPAN_V
            means -= np.outer(seen, gain)
        total = covariance[at_soc, at_soc] + float(np.sum(means[:, at_soc] ** 2))
        assert designed[-1] == pytest.approx(total, rel=1e-3)


def test_they_hold_once_the_start_is_over_and_an_offset_does_not_carry_the_estimate_away() -> None:
    n, soc, offset_A = 7200, 0.5, 0.02 * MODEL.cell.capacity_Ah
    rng, estimates = np.random.default_rng(1), {}
    plain = FuzzyObserver(MODEL)
    settled = plain.replay(plain.initial(soc, 1e-9), np.zeros(200), np.full(200, np.nan), np.full(200, 25.0))[1]
    rest_V = settled[-1, 2]
    voltage_V = rest_V + 1e-3 * rng.standard_normal(n)
    for gain in ("kalman", "steady"):
        observer = FuzzyObserver(MODEL, replace(UNSURE, gain=gain))
        _, rows = observer.replay(observer.initial(soc, 0.02), np.full(n, offset_A), voltage_V, np.full(n, 25.0))
        estimates[gain] = rows[-600:, 0]
    # Counted alone, the offset makes 4 points in two hours.
    assert np.abs(estimates["steady"] - soc).max() < 0.02
    assert not np.allclose(estimates["steady"], estimates["kalman"], atol=1e-5)
