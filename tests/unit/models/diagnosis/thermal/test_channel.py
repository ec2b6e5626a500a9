"""Which effect changed the temperature, against a heat balance that is written down."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.diagnosis.thermal.channel import ThermalComparison, WarmthTrial, compare_temperature
from models.effects import effect
from models.network.signals import KELVIN
from tests.unit.models.diagnosis.hand_reference import SOC, reference
from tests.unit.models.diagnosis.thermal.warm_runs import (
    AMBIENT_DEGC,
    BALANCE,
    RESISTANCE_K_PER_W,
    TIME_CONSTANT_S,
    warm_run,
)

EFFECTS = [effect(name) for name in ("heat_transfer", "reversible_heat", "series_resistance", "temperature_sensor")]


def found_in(run: GridRun) -> ThermalComparison:
    found = compare_temperature(reference(), BALANCE, [run], [SOC], EFFECTS, [np.zeros(len(run))])
    assert found is not None
    return found


def test_nothing_is_large_where_the_cell_is_as_it_was() -> None:
    found = found_in(warm_run())
    assert found.mse_K2 == pytest.approx(1e-4, rel=0.1)
    assert not found.large and found.pairs == ()
    # Every effect on the temperature is tried all the same, and no other.
    assert {trial.effect.name for trial in found.trials} == {"heat_transfer", "reversible_heat", "temperature_sensor"}


def test_less_cooling_is_named_and_sized() -> None:
    found = found_in(warm_run(resistance_K_per_W=2.0 * RESISTANCE_K_PER_W, time_constant_s=2.0 * TIME_CONSTANT_S))
    first = found.trials[0]
    assert found.large
    assert first.effect.name == "heat_transfer"
    assert first.values[0] == pytest.approx(0.5 / RESISTANCE_K_PER_W, rel=0.01)
    assert 0.0 < first.std[0] < 0.02 * first.values[0]
    assert first.mse_K2 == pytest.approx(1e-4, rel=0.2)
    assert found.share(first) > 0.99 and found.share_of_new(first) == pytest.approx(1.0, abs=0.01)


def test_reversible_heat_is_named_and_sized() -> None:
    added_W = 3e-4 * warm_run().current_A * (AMBIENT_DEGC + KELVIN)
    first = found_in(warm_run(added_W=added_W)).trials[0]
    assert first.effect.name == "reversible_heat"
    assert first.values[0] == pytest.approx(3e-4, rel=0.03)


def test_a_wrong_reading_is_named_with_gain_and_offset() -> None:
    run = warm_run()
    first = found_in(replace(run, temperature_degC=22.0 + 0.6 * (run.temperature_degC - 22.0) + 1.0)).trials[0]
    assert first.effect.name == "temperature_sensor"
    assert first.values == pytest.approx((0.6, 1.0), abs=0.01)


def test_two_at_once_are_told_by_their_pair() -> None:
    added_W = 3e-4 * warm_run().current_A * (AMBIENT_DEGC + KELVIN)
    run = warm_run(added_W=added_W, resistance_K_per_W=2.0 * RESISTANCE_K_PER_W, time_constant_s=2.0 * TIME_CONSTANT_S)
    found = found_in(run)
    best = {trial.effect.name: trial for trial in found.pairs[0]}
    assert set(best) == {"heat_transfer", "reversible_heat"}
    assert best["heat_transfer"].values[0] == pytest.approx(0.5 / RESISTANCE_K_PER_W, rel=0.03)
    assert best["reversible_heat"].values[0] == pytest.approx(3e-4, rel=0.05)
    # Three effects make three pairs, in order of what they leave.
    assert len(found.pairs) == 3
    assert found.pairs[0][0].mse_K2 < 0.1 * found.trials[0].mse_K2


def test_without_a_balance_or_ambient_nothing_can_be_judged() -> None:
    run = warm_run(600)
    nothing = [np.zeros(600)]
    assert compare_temperature(reference(), None, [run], [SOC], EFFECTS, nothing) is None
    blind = replace(run, ambient_degC=None)
    assert compare_temperature(reference(), BALANCE, [blind], [SOC], EFFECTS, nothing) is None


@pytest.mark.parametrize(
    ("own_mse_K2", "mse_K2", "large"),
    [(1e-4, 0.0624, False), (1e-4, 0.0626, True), (0.04, 0.159, False), (0.04, 0.161, True)],
)
def test_large_is_a_quarter_of_a_kelvin_and_twice_the_own_error(own_mse_K2: float, mse_K2: float, large: bool) -> None:
    assert ThermalComparison((), own_mse_K2, mse_K2, (), ()).large == large


def test_shares_of_the_whole_and_of_what_is_new() -> None:
    trial = WarmthTrial(effect("heat_transfer"), (0.1,), (0.01,), 0.25)
    found = ThermalComparison((), 0.2, 1.0, (trial,), ())
    assert found.share(trial) == 0.75
    assert found.share_of_new(trial) == pytest.approx(0.75 / 0.8)
    assert ThermalComparison((), 0.0, 0.0, (), ()).share(trial) == 0.0
