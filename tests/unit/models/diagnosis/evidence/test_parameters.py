"""Parameters of effects in the units of the public contract, with their standard deviations."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.evidence.candidates import Comparison, try_effect
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.evidence.parameters import Value, parameters
from models.diagnosis.reference.samples import Samples
from models.effects import effect
from models.network.signals.direction import hysteresis_state
from models.network.signals.filters import low_pass
from tests.unit.models.diagnosis.hand_reference import RESISTANCE_OHM, SLOPE_V, compared, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH

SWINGS_A = np.concatenate([np.full(700, 3.0), np.zeros(200), np.full(700, -3.0)])


def read(comparison: Comparison, name: str) -> dict[str, Value]:
    return parameters(comparison, try_effect(comparison, effect(name)))


def test_the_mean_of_noisy_samples_has_its_standard_error() -> None:
    """Nothing but an offset: value and deviation are those of a mean."""
    error_V = 5e-3 + np.tile([1e-3, -1e-3], 200)
    evidence = Evidence(error_V, np.zeros((400, 1)), np.eye(1), np.arange(400) // 40)
    comparison = Comparison(Samples((), evidence.blocks), (), {"voltage_offset": np.ones((400, 1))}, evidence, 0, 0)
    found = read(comparison, "voltage_offset")["offset_V"]
    assert found.value == pytest.approx(5e-3, rel=1e-4)
    assert found.std == pytest.approx(1e-3 / np.sqrt(400.0), rel=1e-3)
    assert found.unit == "V"


def test_a_capacity_is_told_in_ampere_hours() -> None:
    comparison = compared(true_run(SWINGS_A, capacity_Ah=0.8 * CAPACITY_AH, noise_V=1e-3), ["capacity"])
    found = read(comparison, "capacity")["capacity_Ah"]
    assert found.value == pytest.approx(0.8 * CAPACITY_AH, abs=4.0 * (found.std or 0.0))
    # The voltage's slope over the relative change: slope times charged share of the capacity over 0.8 squared.
    charged = np.cumsum(SWINGS_A) / 3600.0 / CAPACITY_AH
    expected = CAPACITY_AH * 1e-3 / (SLOPE_V / 0.8**2 * np.sqrt(charged @ charged))
    assert found.std == pytest.approx(expected, rel=0.4)
    assert found.unit == "Ah"


def test_a_start_is_told_as_the_state_of_charge_itself() -> None:
    comparison = compared(true_run(steps_A(500), soc=0.53), ["initial_soc"])
    assert read(comparison, "initial_soc")["soc"].value == pytest.approx(0.53, abs=1e-4)


def test_an_offset_of_the_current_keeps_its_sign() -> None:
    # What the sensor reads too much did not charge the cell, and met no resistance.
    run = true_run(steps_A(3000))
    drift_V = SLOPE_V * 0.03 * run.time_s / 3600.0 / CAPACITY_AH
    wrong = replace(run, voltage_V=run.voltage_V - drift_V - 0.03 * RESISTANCE_OHM)
    assert read(compared(wrong, ["current_offset"]), "current_offset")["offset_A"].value == pytest.approx(
        0.03, rel=0.01
    )


def test_a_loop_has_its_amplitude_and_a_rate_between_those_of_the_grid() -> None:
    current = steps_A(3000, largest_A=4.0, length=100)
    loop_V = 0.012 * hysteresis_state(current, 37.0, 1.0, CAPACITY_AH)
    found = read(compared(true_run(current, added_V=loop_V, noise_V=5e-4), ["hysteresis"]), "hysteresis")
    assert found["amplitude_V"].value == pytest.approx(0.012, rel=0.03)
    assert found["rate"].value == pytest.approx(37.0, rel=0.1)
    for each in found.values():
        assert each.std is not None and 0.0 < each.std < 0.2 * each.value


def test_a_slow_relaxation_has_a_resistance_and_a_time_constant() -> None:
    current = steps_A(4000, largest_A=4.0, length=400)
    added_V = 0.01 * low_pass(current, 400.0, 1.0)
    found = read(compared(true_run(current, added_V=added_V, noise_V=5e-4), ["relaxation"]), "relaxation")
    assert found["resistance_Ohm"].value == pytest.approx(0.01, rel=0.05)
    assert found["time_constant_s"].value == pytest.approx(400.0, rel=0.05)
    assert found["time_constant_s"].unit == "s"


def test_a_form_with_one_shape_has_no_second_parameter() -> None:
    degC = 25.0 + 8.0 * np.sin(np.arange(2000) / 200.0)
    run = true_run(np.zeros(2000), temperature_degC=degC, added_V=3e-4 * (degC - 25.0), noise_V=2e-4)
    found = read(compared(run, ["entropic_voltage"]), "entropic_voltage")
    assert list(found) == ["dU_dT_V_per_K"]
    assert found["dU_dT_V_per_K"].value == pytest.approx(3e-4, rel=0.02)


def test_a_curve_is_told_at_five_states_of_charge_in_millivolts() -> None:
    """Known from 0.1 to 0.9: told at 0.18, 0.34, 0.5, 0.66 and 0.82, as far as the run has been."""
    current = np.concatenate([np.full(1000, 2.6), np.full(2000, -2.6)])
    shift_V = 0.004 + 0.01 * (0.5 + np.cumsum(current) / 3600.0 / CAPACITY_AH - 0.5)
    found = read(compared(true_run(current, added_V=shift_V, noise_V=2e-4), ["ocv_shape"]), "ocv_shape")
    points = (0.18, 0.34, 0.50, 0.66, 0.82)
    assert list(found) == [f"shift_mV at SoC {each:.2f}" for each in points]
    for soc in points:
        each = found[f"shift_mV at SoC {soc:.2f}"]
        assert each.unit == "mV"
        assert each.value == pytest.approx(4.0 + 10.0 * (soc - 0.5), abs=0.15)
