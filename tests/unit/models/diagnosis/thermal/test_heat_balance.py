"""The heat balance of training runs, found again from temperatures that were stepped by hand."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.thermal.heat_balance import fit_heat_balance, has_temperature, thermal_view
from models.network.signals import KELVIN
from tests.unit.models.diagnosis.hand_reference import RESISTANCE_OHM, SOC, reference, true_run
from tests.unit.models.diagnosis.thermal.warm_runs import AMBIENT_DEGC, RESISTANCE_K_PER_W, TIME_CONSTANT_S, warm_run


def test_resistance_and_time_constant_are_found() -> None:
    found = fit_heat_balance(reference(), [warm_run(), warm_run(seed=1)], [SOC, SOC])
    assert found is not None
    assert found.resistance_K_per_W == pytest.approx(RESISTANCE_K_PER_W, rel=0.01)
    assert found.time_constant_s == pytest.approx(TIME_CONSTANT_S, rel=0.02)
    assert found.dU_dT_V_per_K == pytest.approx(0.0, abs=2e-6)
    assert found.mse_K2 == pytest.approx(1e-4, rel=0.1)


def test_reversible_heat_is_told_from_the_losses() -> None:
    plain = warm_run()
    # Close to 295 K throughout: 1e-4 V/K is 30 mW for an ampere.
    warm = warm_run(added_W=1e-4 * plain.current_A * (AMBIENT_DEGC + KELVIN))
    found = fit_heat_balance(reference(), [warm], [SOC])
    assert found is not None
    assert found.dU_dT_V_per_K == pytest.approx(1e-4, rel=0.05)
    assert found.resistance_K_per_W == pytest.approx(RESISTANCE_K_PER_W, rel=0.05)


def test_a_cell_that_hardly_warms_up_says_nothing() -> None:
    assert fit_heat_balance(reference(), [warm_run(resistance_K_per_W=1.0)], [SOC]) is None


def test_without_ambient_there_is_no_balance() -> None:
    run = warm_run(2000)
    assert fit_heat_balance(reference(), [run, replace(run, ambient_degC=None)], [SOC, SOC]) is None


def test_a_temperature_is_known_throughout_or_not_at_all() -> None:
    run = warm_run(600)
    assert has_temperature(run)
    assert run.ambient_degC is not None
    gap = np.arange(600) == 300
    assert not has_temperature(replace(run, ambient_degC=None))
    assert not has_temperature(replace(run, temperature_degC=np.where(gap, np.nan, run.temperature_degC)))
    assert not has_temperature(replace(run, ambient_degC=np.where(gap, np.nan, run.ambient_degC)))


def test_heat_is_the_current_times_what_is_left_of_the_voltage() -> None:
    run = warm_run(600)
    view = thermal_view(reference(), run, SOC, np.zeros(600))
    np.testing.assert_allclose(view.heat_W, RESISTANCE_OHM * run.current_A**2, atol=1e-9)
    # An offset of 10 mV in the voltage that warms nothing is taken off before.
    off = replace(run, voltage_V=run.voltage_V + 0.01)
    np.testing.assert_allclose(thermal_view(reference(), off, SOC, np.full(600, 0.01)).heat_W, view.heat_W, atol=1e-9)
    np.testing.assert_allclose(
        thermal_view(reference(), off, SOC, np.zeros(600)).heat_W - view.heat_W, 0.01 * run.current_A, atol=1e-9
    )


def test_heat_goes_on_where_the_voltage_is_missing() -> None:
    run = true_run(np.full(100, 2.0), ambient_degC=AMBIENT_DEGC)
    holes = np.where(np.arange(100) % 3 == 1, np.nan, run.voltage_V)
    view = thermal_view(reference(), replace(run, voltage_V=holes), SOC, np.zeros(100))
    np.testing.assert_allclose(view.heat_W, RESISTANCE_OHM * 4.0, atol=1e-9)
