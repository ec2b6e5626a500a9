"""Effects tried one by one on an error whose cause is known."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.evidence.candidates import (
    Comparison,
    beside,
    noise_V2,
    simulate_again,
    try_effect,
    try_lean,
)
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.reference.samples import Samples
from models.effects import effect
from models.network.signals.direction import hysteresis_state
from tests.unit.models.diagnosis.hand_reference import (
    RESISTANCE_OHM,
    SLOPE_V,
    compared,
    reference,
    steps_A,
    true_run,
)
from tests.unit.models.hand_network import CAPACITY_AH


def test_columns_stand_for_each_effect() -> None:
    comparison = compared(true_run(steps_A(300)), ["series_resistance", "ocv_shape"])
    assert list(comparison.columns) == ["series_resistance", "ocv_shape"]
    assert comparison.columns["ocv_shape"].shape == (300, 16)
    assert comparison.evidence.regressors.shape == (300, reference().layout.size + 17)


def test_a_linear_effect_is_sized_and_explains_everything() -> None:
    current = steps_A(400)
    comparison = compared(true_run(current, added_V=0.004 * current), ["series_resistance"])
    found = try_effect(comparison, effect("series_resistance"))
    assert found.solution.coefficients[0] == pytest.approx(0.004, rel=1e-3)
    np.testing.assert_allclose(found.contribution_V, 0.004 * current, atol=1e-5)
    assert found.solution.cost < 1e-3 * comparison.evidence.cost
    assert (found.size, found.value) == (1, None)


def test_a_capacity_is_found_by_simulating_again() -> None:
    """A fifth too small is far from linear: 1 / 0.8 is 1.25, first order says 1.2."""
    current = np.concatenate([np.full(700, 3.0), np.zeros(200), np.full(700, -3.0)])
    run = true_run(current, capacity_Ah=0.8 * CAPACITY_AH)
    comparison = compared(run, ["capacity"])
    found = try_effect(comparison, effect("capacity"))
    assert found.value == pytest.approx(-0.2, abs=1e-4)
    assert found.variance is not None and found.variance > 0.0
    true_V = SLOPE_V * run.charge_Ah / CAPACITY_AH * (1.0 / 0.8 - 1.0)
    np.testing.assert_allclose(found.contribution_V, true_V, atol=1e-5)


def test_steps_begin_where_they_are_told() -> None:
    current = np.concatenate([np.full(700, 3.0), np.zeros(200), np.full(700, -3.0)])
    comparison = compared(true_run(current, capacity_Ah=0.9 * CAPACITY_AH), ["capacity"])
    found = simulate_again(comparison, effect("capacity"), start=-0.05)
    assert found.value == pytest.approx(-0.1, abs=1e-4)


def test_a_value_stays_within_its_limits() -> None:
    # An offset of the current of 0.2 A; the most that is believed is 5 % of 2 A.
    run = true_run(steps_A(2000))
    drift_V = -SLOPE_V * 0.2 * run.time_s / 3600.0 / CAPACITY_AH
    comparison = compared(replace(run, voltage_V=run.voltage_V + drift_V - 0.2 * RESISTANCE_OHM), ["current_offset"])
    assert try_effect(comparison, effect("current_offset")).value == pytest.approx(0.05 * CAPACITY_AH)


def test_the_smallest_form_has_the_rate_of_the_loop() -> None:
    current = steps_A(3000, largest_A=4.0, length=100)
    loop_V = 0.012 * hysteresis_state(current, 30.0, 1.0, CAPACITY_AH)
    comparison = compared(true_run(current, added_V=loop_V), ["hysteresis"])
    trial = try_lean(comparison, effect("hysteresis"))
    assert (trial.shape, trial.columns, trial.size) == (30.0, 1, 2)
    assert trial.cost < 1e-4 * comparison.evidence.cost


def test_a_further_column_has_to_be_worth_its_price() -> None:
    """Charge transfer with a little resistance beside it: two columns where they cost nothing, one where they do."""
    current = steps_A(1000)
    added_V = 0.02 * np.arcsinh(current / (2.0 * 0.35 * CAPACITY_AH)) + 2e-4 * current
    comparison = compared(true_run(current, added_V=added_V), ["charge_transfer"])
    free = try_lean(comparison, effect("charge_transfer"))
    dear = try_lean(comparison, effect("charge_transfer"), price=comparison.evidence.cost)
    assert (free.columns, free.size) == (2, 3)
    assert (dear.columns, dear.size) == (1, 2)
    with pytest.raises(ValueError, match="no smaller form"):
        try_lean(comparison, effect("series_resistance"))


def bare_comparison(error_V: np.ndarray, per_block: int) -> Comparison:
    n = len(error_V)
    evidence = Evidence(error_V, np.zeros((n, 1)), np.eye(1), np.arange(n) // per_block)
    return Comparison(Samples((), evidence.blocks), (), {}, evidence, 1e-6, 1e-6)


def test_noise_that_hangs_together_counts_by_the_block() -> None:
    """Ten samples of one sign tell what one of ten times the variance does."""
    signs = np.where(np.random.default_rng(0).random(40) < 0.5, -1.0, 1.0)
    together = bare_comparison(np.repeat(2e-3 * signs, 10), 10)
    offset = effect("voltage_offset")
    nothing = try_effect(replace(together, columns={"voltage_offset": np.zeros((400, 1))}), offset)
    assert noise_V2(together, nothing) == pytest.approx(10 * 4e-6)
    alternating = bare_comparison(np.tile([2e-3, -2e-3], 200), 10)
    assert noise_V2(alternating, nothing) == pytest.approx(4e-6)


def test_what_an_effect_explains_is_no_noise() -> None:
    error_V = np.full(400, 5e-3) + np.tile([1e-3, -1e-3], 200)
    comparison = replace(bare_comparison(error_V, 10), columns={"voltage_offset": np.ones((400, 1))})
    found = try_effect(comparison, effect("voltage_offset"))
    assert noise_V2(comparison, found) == pytest.approx(1e-6, rel=1e-3)


def test_beside_another_effect_a_candidate_is_what_it_is_alone_without_that_one() -> None:
    current = steps_A(600)
    names = ["series_resistance", "voltage_offset"]
    both = compared(true_run(current, added_V=0.004 * current + 0.003), names)
    without = replace(both, evidence=replace(both.evidence, error_V=both.evidence.error_V - 0.003))
    alone = try_effect(both, effect("series_resistance"))
    found = beside(without, alone, both)
    assert found.solution.coefficients[0] == pytest.approx(0.004, rel=1e-3)
    assert found.solution.cost < 1e-3 * alone.solution.cost


def test_beside_another_effect_a_value_moves_with_it() -> None:
    current = np.concatenate([np.full(700, 3.0), np.zeros(200), np.full(700, -3.0)])
    run = true_run(current, capacity_Ah=0.9 * CAPACITY_AH)
    disturbed = compared(replace(run, voltage_V=run.voltage_V + 0.002), ["capacity", "voltage_offset"])
    alone = try_effect(disturbed, effect("capacity"))
    clean = replace(disturbed, evidence=replace(disturbed.evidence, error_V=disturbed.evidence.error_V - 0.002))
    found = beside(clean, alone, disturbed)
    assert alone.value is not None and found.value is not None
    assert abs(found.value + 0.1) < min(0.005, 0.5 * abs(alone.value + 0.1))
