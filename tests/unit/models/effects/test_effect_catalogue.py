import numpy as np
import pytest

from models.data.errors import ModelError
from models.effects import effect
from models.effects.reading import Reading
from models.effects.spline import SplineBasis
from models.effects.view import View
from models.network.signals.filters import low_pass
from models.network.structure import full_structure, minimal_structure
from tests.unit.models.effects.linear_cell import CAPACITY_AH, PER_K, RESISTANCE_OHM, SLOPE_V, linear_view, thermal_view


@pytest.fixture(scope="module")
def view() -> View:
    return linear_view()


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ModelError, match=r"'gremlins' is unknown.*hysteresis"):
        effect("gremlins")


def test_temperature_scales_every_current_of_a_structure_without_feedback() -> None:
    extend = effect("temperature_dependence").extend
    assert extend is not None
    relaxing = effect("relaxation").extend
    assert relaxing is not None
    before = relaxing(minimal_structure(1.0, output_order=0), {"time_constant_s": 300.0}, CAPACITY_AH)
    after = extend(before, {"activation_K": 2400.0}, CAPACITY_AH)
    assert {"scaled_current:2400", "low_pass:300/2400"} <= set(after.signals)
    # A second step adds to the first.
    again = extend(after, {"activation_K": 100.0}, CAPACITY_AH)
    assert "scaled_current:2500" in again.signals


def test_what_the_full_structure_has_is_not_added_again() -> None:
    full = full_structure(1.0)
    for name in ("charge_discharge_asymmetry", "temperature_dependence"):
        extend = effect(name).extend
        assert extend is not None
        assert extend(full, {}, CAPACITY_AH) == full


@pytest.mark.parametrize("name", ["hysteresis", "charge_transfer", "entropic_voltage"])
def test_an_input_that_is_there_is_not_added_with_other_constants(name: str) -> None:
    extend = effect(name).extend
    assert extend is not None
    once = extend(minimal_structure(1.0, output_order=0), {}, CAPACITY_AH)
    assert extend(once, {"rate": 7.0, "exchange_current_A": 0.3}, CAPACITY_AH) == once


def test_capacity_scales_the_charge_since_the_start(view: View) -> None:
    shift = effect("capacity").shift
    assert shift is not None
    expected = SLOPE_V * (view.soc - 0.5)[view.index] * (1.0 / 0.8 - 1.0)
    np.testing.assert_allclose(shift.voltage(view, -0.2), expected, atol=1e-12)
    assert shift.physical(view, -0.2) == pytest.approx(1.6)


def test_a_gain_of_the_current_scales_charge_and_load(view: View) -> None:
    shift = effect("current_gain").shift
    assert shift is not None
    share = 1.0 / 1.02 - 1.0
    expected = SLOPE_V * (view.soc - 0.5)[view.index] * share + RESISTANCE_OHM * view.run.current_A[view.index] * share
    np.testing.assert_allclose(shift.voltage(view, 0.02), expected, atol=1e-12)


def test_a_gain_of_the_voltage_is_a_share_of_it(view: View) -> None:
    forms = effect("voltage_gain").expected.forms
    assert forms is not None
    (form,) = forms(view)
    np.testing.assert_allclose(form.columns[:, 0] / form.told[0].weights[0], view.voltage_V, atol=1e-12)


def test_kinetics_may_bend_more_at_the_resistance_that_small_currents_met_before(view: View) -> None:
    forms = effect("charge_transfer").expected.forms
    assert forms is not None
    whole, bent = forms(view)[:2]
    assert whole.fixed == bent.fixed
    current_A = view.run.current_A[view.index]
    drive = current_A / (2.0 * whole.fixed[0][2])
    np.testing.assert_allclose(whole.columns[:, 0] / whole.told[0].weights[0], np.arcsinh(drive), atol=1e-12)
    np.testing.assert_allclose(bent.columns[:, 0] / bent.told[0].weights[0], np.arcsinh(drive) - drive, atol=1e-12)


def test_gains_are_put_right() -> None:
    read = Reading(1.02, 3.737, 25.0, 25.0)
    for name, value in (("current_gain", 0.02), ("voltage_gain", 0.01)):
        correction = effect(name).correction
        assert correction is not None and correction.sample is not None
        assert not correction.possible({"gain": -1.0})
        read = correction.sample(read, {"gain": value})
    assert read.current_A == pytest.approx(1.0) and read.voltage_V == pytest.approx(3.7)


def test_a_warm_core_resists_less_after_minutes_of_load(view: View) -> None:
    shift = effect("core_temperature").shift
    assert shift is not None
    change_V = shift.voltage(view, 5.0)
    current_A = view.run.current_A[view.index]
    # Against the current, whichever way it flows, and more once the core has warmed up.
    assert (change_V * current_A <= 1e-12).all()
    heat_W = RESISTANCE_OHM * view.run.current_A**2
    np.testing.assert_allclose(view.loss_W, heat_W, atol=1e-12)
    settled = low_pass(heat_W, 100.0, 1.0)[view.index]
    np.testing.assert_allclose(change_V, -RESISTANCE_OHM * PER_K * 5.0 * settled * current_A, atol=1e-9)


def test_a_leak_and_an_offset_differ_by_the_current_alone(view: View) -> None:
    leak, offset = effect("self_discharge").shift, effect("current_offset").shift
    assert leak is not None and offset is not None
    drift = -SLOPE_V * 0.01 * view.run.time_s[view.index] / 3600.0 / CAPACITY_AH
    np.testing.assert_allclose(leak.voltage(view, 0.01), drift, atol=1e-12)
    np.testing.assert_allclose(offset.voltage(view, 0.01), drift - RESISTANCE_OHM * 0.01, atol=1e-12)


def test_delay_is_the_voltage_of_the_current_before(view: View) -> None:
    regressors = effect("dead_time").regressors
    assert regressors is not None
    current = view.run.current_A
    later = RESISTANCE_OHM * (np.concatenate([current[:1], current[:-1]]) - current)
    np.testing.assert_allclose(regressors(view)[:, 0], later[view.index], atol=1e-12)


@pytest.mark.parametrize("delay_s", [0.4, 1.0, 1.7, -0.6])
def test_a_delay_between_two_samples_is_a_straight_line(view: View, delay_s: float) -> None:
    shift = effect("dead_time").shift
    assert shift is not None
    time_s, current = view.run.time_s, view.run.current_A
    later = RESISTANCE_OHM * (np.interp(time_s - delay_s, time_s, current) - current)
    np.testing.assert_allclose(shift.voltage(view, delay_s), later[view.index], atol=1e-12)


def test_warmer_cells_resist_less_with_a_positive_activation(view: View) -> None:
    shift = effect("temperature_dependence").shift
    assert shift is not None
    change = shift.voltage(view, 2000.0)
    current, temperature = view.run.current_A[view.index], view.run.temperature_degC[view.index]
    warm = (temperature > 26.0) & (np.abs(current) > 0.1)
    assert (change[warm] * current[warm] < 0.0).all()
    assert abs(shift.voltage(view, 0.0)).max() == 0.0


def test_heat_balance_settles_at_heat_times_resistance() -> None:
    assert thermal_view().simulated()[-1] == pytest.approx(30.0, abs=1e-3)


def test_cooling_moves_height_and_speed_together() -> None:
    warmth = effect("heat_transfer").warmth
    assert warmth is not None
    view = thermal_view()
    weaker = warmth.temperature(view, (np.log(2.0),))
    assert weaker[-1] == pytest.approx(40.0, abs=0.05)
    # The heat capacity stays: at first both warm alike.
    assert weaker[20] - 20.0 == pytest.approx(view.simulated()[20] - 20.0, rel=0.05)
    assert warmth.physical(view, (np.log(2.0),))[0] == pytest.approx(0.1)


def test_a_sensor_gain_scales_the_rise_only() -> None:
    assert effect("temperature_sensor").parameters[0].name == "offset_K", "what its power is told by"
    warmth = effect("temperature_sensor").warmth
    assert warmth is not None
    view = thermal_view()
    read = warmth.temperature(view, (1.0, 0.5))
    np.testing.assert_allclose(read[100:] - 21.0, 0.5 * (view.simulated()[100:] - 20.0), atol=1.5)
    assert read[-1] == pytest.approx(26.0, abs=1e-2)


def test_reversible_heat_changes_sign_with_the_coefficient() -> None:
    warmth = effect("reversible_heat").warmth
    assert warmth is not None
    view = thermal_view()
    plain, cooler = view.simulated()[-1], warmth.temperature(view, (1e-4,))[-1]
    assert cooler - plain == pytest.approx(-3.0 * 293.15 * 1e-4 * 5.0, rel=0.01)


def test_bumps_add_up_to_one_and_go_on_straight() -> None:
    basis = SplineBasis(0.1, 0.9, 9)
    x = np.linspace(-0.2, 1.2, 200)
    values = basis.matrix(x)
    np.testing.assert_allclose(values.sum(axis=1), 1.0, atol=1e-6)
    line = values @ basis.centres
    np.testing.assert_allclose(line, x, atol=1e-3)


def test_a_core_that_passes_its_heat_on_worse_warms_the_case_as_much_but_later() -> None:
    warmth = effect("core_temperature").warmth
    assert warmth is not None
    view = thermal_view(n=20000)
    was, now = view.simulated(), warmth.temperature(view, (3.0,))
    assert now[600] < was[600] - 0.5
    assert now[-1] == pytest.approx(was[-1], abs=0.05)
    np.testing.assert_allclose(warmth.temperature(view, (0.0,)), was)
