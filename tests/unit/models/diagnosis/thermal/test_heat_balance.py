"""The heat balance of training runs, found again from temperatures that were stepped by hand."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.diagnosis.thermal.heat_balance import fit_views, has_temperature
from models.effects.thermal_view import ThermalView
from models.network.signals import KELVIN
from models.network.signals.filters import low_pass
from tests.unit.models.diagnosis.hand_reference import RESISTANCE_OHM
from tests.unit.models.diagnosis.thermal.warm_runs import AMBIENT_DEGC, RESISTANCE_K_PER_W, TIME_CONSTANT_S, warm_run
from tests.unit.models.hand_network import DT_S


def view_of(run: GridRun) -> ThermalView:
    """The run with the heat of its resistance."""
    assert run.ambient_degC is not None
    heat_W = RESISTANCE_OHM * run.current_A**2
    return ThermalView(heat_W, run.current_A, run.ambient_degC, run.temperature_degC, run.dt_s, 1.0, 600.0)


def test_resistance_and_time_constant_are_found() -> None:
    found = fit_views([view_of(warm_run()), view_of(warm_run(seed=1))])
    assert found is not None
    assert found.resistance_K_per_W == pytest.approx(RESISTANCE_K_PER_W, rel=0.01)
    assert found.time_constant_s == pytest.approx(TIME_CONSTANT_S, rel=0.02)
    assert found.dU_dT_V_per_K == pytest.approx(0.0, abs=2e-6)
    assert found.mse_K2 == pytest.approx(1e-4, rel=0.1)


def test_reversible_heat_is_told_from_the_losses() -> None:
    plain = warm_run()
    # Close to 295 K throughout: 1e-4 V/K is 30 mW for an ampere.
    warm = warm_run(added_W=1e-4 * plain.current_A * (AMBIENT_DEGC + KELVIN))
    found = fit_views([view_of(warm)])
    assert found is not None
    assert found.dU_dT_V_per_K == pytest.approx(1e-4, rel=0.05)
    assert found.resistance_K_per_W == pytest.approx(RESISTANCE_K_PER_W, rel=0.05)


def test_a_skin_that_all_follows_sooner_is_no_slow_cell() -> None:
    # Between two places of the grid, while four times as much lies on one.
    time_constant_s = 335.0
    plain = warm_run(18_000, time_constant_s=time_constant_s)
    chamber_K = np.repeat([0.0, 8.0, -12.0, 15.0, 3.0], 3600)
    followed_K = low_pass(chamber_K, time_constant_s, DT_S)
    assert plain.ambient_degC is not None
    run = replace(
        plain,
        ambient_degC=plain.ambient_degC + chamber_K,
        temperature_degC=plain.temperature_degC + followed_K,
    )
    found = fit_views([view_of(run)])
    assert found is not None
    assert found.time_constant_s == pytest.approx(time_constant_s, rel=0.05)
    assert abs(found.quick_heat) < 0.1 and abs(found.quick_chamber) < 0.1


def test_a_cell_that_hardly_warms_up_says_nothing() -> None:
    assert fit_views([view_of(warm_run(resistance_K_per_W=1.0))]) is None


def test_a_cell_that_its_heat_does_not_warm_says_nothing() -> None:
    assert fit_views([view_of(warm_run(resistance_K_per_W=-RESISTANCE_K_PER_W))]) is None


def test_a_temperature_is_known_throughout_or_not_at_all() -> None:
    run = warm_run(600)
    assert has_temperature(run)
    assert run.ambient_degC is not None
    gap = np.arange(600) == 300
    assert not has_temperature(replace(run, ambient_degC=None))
    assert not has_temperature(replace(run, temperature_degC=np.where(gap, np.nan, run.temperature_degC)))
    assert not has_temperature(replace(run, ambient_degC=np.where(gap, np.nan, run.ambient_degC)))
