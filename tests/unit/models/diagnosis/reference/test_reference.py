"""The reference model: what it simulates, and what is found of it in runs."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.diagnosis.reference.layout import Shape
from models.diagnosis.reference.reference import fit_reference
from tests.unit.models.diagnosis.hand_reference import RESISTANCE_OHM, SOC, reference, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH, grid_run


def test_voltage_of_a_line_and_a_resistance() -> None:
    model, run = reference(), true_run(steps_A(300))
    index, soc = np.arange(0, 300, 3), SOC + run.charge_Ah / CAPACITY_AH
    inputs = model.inputs(run, index, run.current_A, run.temperature_degC, np.full(len(run), 0.5))
    np.testing.assert_allclose(model.voltage_V(inputs, soc[index]), run.voltage_V[index], atol=1e-12)


def test_voltage_is_what_the_regressors_give() -> None:
    model, run = reference(with_temperature=True, shape=Shape(2000.0, 0.05, 100.0)), true_run(steps_A(300))
    rng = np.random.default_rng(2)
    model = replace(model, coefficients=model.coefficients + 1e-3 * rng.standard_normal(model.layout.size))
    index, soc = np.arange(300), SOC + run.charge_Ah / CAPACITY_AH
    inputs = model.inputs(run, index, run.current_A, 25.0 + 0.02 * run.time_s, np.full(len(run), 0.5))
    by_regressors = model.layout.regressors(inputs, soc) @ model.coefficients
    np.testing.assert_allclose(model.voltage_V(inputs, soc), by_regressors, atol=1e-12)


def test_the_open_circuit_curve_is_the_first_block_alone() -> None:
    np.testing.assert_allclose(reference().open_circuit_V(np.array([0.1, 0.5, 0.95])), [3.47, 3.75, 4.065], atol=1e-12)


def test_a_run_on_another_grid_is_refused() -> None:
    run = grid_run(steps_A(50), 25.0)
    with pytest.raises(ModelError, match="grid of 2 s; the model's is 1 s"):
        reference().inputs(
            replace(run, dt_s=2.0), np.arange(50), run.current_A, run.temperature_degC, np.full(len(run), 0.5)
        )


def test_overvoltage_is_the_slope_at_the_runs_own_current() -> None:
    model, run = reference(), true_run(np.full(40, 1.0))
    transfer = next(block for block in model.layout.blocks if block.term == "charge_transfer")
    coefficients = model.coefficients.copy()
    coefficients[transfer.part] = 0.01
    soc, index = SOC + run.charge_Ah / CAPACITY_AH, np.arange(40)
    other_A = np.full(40, 0.5)
    found = replace(model, coefficients=coefficients).overvoltage_V(run, soc, index, other_A)
    # d asinh(I / a) / dI = 1 / hypot(a, I), with an exchange current of 0.2 C, which is 0.4 A.
    np.testing.assert_allclose(found, 0.5 * (RESISTANCE_OHM + 0.01 / np.hypot(0.4, 1.0)), rtol=1e-9)


def test_the_open_circuit_curve_is_no_overvoltage() -> None:
    model, run = reference(), true_run(np.full(40, 1.0))
    found = model.overvoltage_V(run, np.full(40, SOC), np.arange(40), np.zeros(40))
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


@pytest.fixture(scope="module")
def run() -> GridRun:
    return true_run(steps_A(1500, largest_A=4.0, length=60), noise_V=5e-4)


def test_a_fit_finds_the_cell_and_says_where_it_has_been(run: GridRun) -> None:
    unknown = replace(run, temperature_degC=np.full(len(run), np.nan))
    found = fit_reference([unknown], [SOC], CAPACITY_AH, Shape())
    soc = SOC + run.charge_Ah / CAPACITY_AH
    assert found.own_rms_V == pytest.approx(5e-4, rel=0.1)
    assert found.held_out_rms_V >= found.own_rms_V
    assert found.soc_range == (soc.min(), soc.max()) == found.domain["soc"]
    assert found.domain["current_A"] == (run.current_A.min(), run.current_A.max())
    assert "temperature_degC" not in found.domain and not found.layout.with_temperature
    drop_V = found.overvoltage_V(unknown, soc, np.arange(len(run)), run.current_A)
    loaded = run.current_A != 0.0
    assert np.median(drop_V[loaded] / run.current_A[loaded]) == pytest.approx(RESISTANCE_OHM, rel=0.05)


def test_a_known_temperature_is_a_part_of_the_domain(run: GridRun) -> None:
    warm = replace(run, temperature_degC=np.linspace(20.0, 22.0, len(run)))
    found = fit_reference([warm], [SOC], CAPACITY_AH, Shape())
    assert found.domain["temperature_degC"] == (20.0, 22.0)
    assert found.layout.with_temperature


def activated(seed: int, low_degC: float, high_degC: float) -> GridRun:
    """A resistance that changes with temperature by 3000 K."""
    plain = true_run(steps_A(1500, seed, largest_A=4.0, length=60), noise_V=2e-4)
    degC = 0.5 * (low_degC + high_degC) + 0.5 * (high_degC - low_degC) * np.sin(plain.time_s / 150.0)
    slowed = np.exp(3000.0 * (1.0 / (degC + 273.15) - 1.0 / 298.15))
    voltage_V = plain.voltage_V + 2.0 * RESISTANCE_OHM * (slowed - 1.0) * plain.current_A
    return replace(plain, temperature_degC=degC, voltage_V=voltage_V + RESISTANCE_OHM * plain.current_A)


def test_the_activation_is_chosen_where_temperature_moves() -> None:
    found = fit_reference([activated(1, 10.0, 40.0)], [SOC], CAPACITY_AH)
    assert found.activation_K in (2000.0, 3000.0, 4500.0)


def test_no_activation_is_asked_for_where_temperature_hardly_moves() -> None:
    found = fit_reference([activated(1, 24.0, 26.5)], [SOC], CAPACITY_AH)
    assert found.activation_K == 0.0
