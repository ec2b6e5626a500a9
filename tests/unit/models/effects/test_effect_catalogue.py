from dataclasses import dataclass

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import GridRun, to_grid
from models.data.timeseries import TimeSeries
from models.effects import effect, effects
from models.effects.spline import SplineBasis
from models.effects.thermal_view import ThermalView
from models.effects.view import ModelInputs, View
from models.network.structure import full_structure, minimal_structure

CONTRACT = {
    "hysteresis", "relaxation", "temperature_dependence", "charge_transfer", "soc_dependence",
    "charge_discharge_asymmetry", "entropic_voltage", "current_offset", "capacity", "initial_soc", "ocv_shape",
    "self_discharge", "series_resistance", "resistance_growth", "voltage_offset", "temperature_sensor", "dead_time",
    "heat_transfer", "reversible_heat",
}  # fmt: skip
SLOPE_V, RESISTANCE_OHM, CAPACITY_AH = 0.8, 0.03, 2.0


@dataclass(frozen=True)
class LinearCell:
    """V = 3 + 0.8 SoC + 30 mOhm I."""

    capacity_Ah: float = CAPACITY_AH
    soc_range: tuple[float, float] = (0.1, 0.9)
    activation_K: float = 0.0

    def inputs(self, run, index, current_A, temperature_degC):
        return ModelInputs(np.zeros(len(index)), current_A[index][None, :])

    def voltage_V(self, inputs, soc):
        return 3.0 + SLOPE_V * soc + RESISTANCE_OHM * inputs.signals[0]

    def overvoltage_V(self, run, soc, index, drive_A):
        return RESISTANCE_OHM * drive_A[index]


def run(n: int = 2000) -> GridRun:
    rng = np.random.default_rng(1)
    current = np.repeat(rng.uniform(-2.0, 2.0, n // 50), 50)
    temperature = 25.0 + 10.0 * np.sin(np.arange(n) / 300.0)
    series = TimeSeries(np.arange(n) * 1.0, current, np.full(n, 3.5), temperature, np.full(n, 25.0))
    return to_grid(series, 1.0)


@pytest.fixture(scope="module")
def view() -> View:
    return View(LinearCell(), run(), 0.5, np.arange(0, 2000, 3))


def test_all_names_of_the_contract_are_there_and_no_other() -> None:
    assert set(effects()) == CONTRACT


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ModelError, match=r"'gremlins' is unknown.*hysteresis"):
        effect("gremlins")


@pytest.mark.parametrize("name", sorted(CONTRACT))
def test_every_effect_says_what_a_person_needs(name: str) -> None:
    found = effect(name)
    assert found.title and len(found.recognise) > 30 and found.source
    assert found.parameters and all(each.unit and each.meaning for each in found.parameters)
    assert (found.regressors is None) == (found.channel == "temperature")
    assert set(found.contains) <= CONTRACT
    assert found.twin is None or effect(found.twin).twin == name
    assert sum(form is not None for form in (found.lean, found.local)) <= 1


@pytest.mark.parametrize("name", sorted(name for name in CONTRACT if effect(name).regressors is not None))
def test_regressors_are_finite_and_not_empty(name: str, view: View) -> None:
    regressors = effect(name).regressors
    assert regressors is not None
    x = regressors(view)
    assert x.shape[0] == len(view.index)
    assert np.isfinite(x).all()
    assert np.abs(x).max() > 0.0


@pytest.mark.parametrize("name", sorted(name for name in CONTRACT if effect(name).extend is not None))
def test_an_extended_structure_differs_and_reads_back(name: str) -> None:
    extend = effect(name).extend
    assert extend is not None
    before = minimal_structure(1.0, output_order=0)
    after = extend(before, {}, CAPACITY_AH)
    assert after != before
    assert type(after).from_json(after.to_json()) == after


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


def thermal_view(heat_W: float = 2.0, n: int = 6000) -> ThermalView:
    still = np.full(n, 20.0)
    return ThermalView(np.full(n, heat_W), np.full(n, -3.0), still, still.copy(), 1.0, 5.0, 400.0)


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
    warmth = effect("temperature_sensor").warmth
    assert warmth is not None
    view = thermal_view()
    read = warmth.temperature(view, (0.5, 1.0))
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
