"""Where the reference model's coefficients are, and what they are multiplied with."""

import numpy as np
import pytest

from models.diagnosis.reference.layout import EXCHANGE_C_RATES, OCV_BUMPS, TIME_CONSTANTS_S, Shape
from models.effects import effect
from tests.unit.models.diagnosis.hand_reference import layout
from tests.unit.models.hand_network import CAPACITY_AH


def test_blocks_follow_each_other_without_gap() -> None:
    plan = layout()
    assert [block.start for block in plan.blocks[1:]] == [block.part.stop for block in plan.blocks[:-1]]
    # A curve of 40, eight currents of 8, four charge transfers and three hystereses of 4.
    assert plan.size == 40 + 8 * 8 + 4 * 4 + 3 * 4


def test_a_measured_temperature_brings_the_entropic_voltage_and_a_warm_resistance() -> None:
    assert layout(with_temperature=True).size == layout().size + 4 + 2 * 4


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("relaxation", 4 * 8),  # the low-passes of 100 s and slower
        ("charge_transfer", 4 * 4),
        ("hysteresis", 3 * 4),
        ("entropic_voltage", 4),
        ("temperature_dependence", 2 * 4),
        ("series_resistance", 0),  # the resistance itself stands for no effect
    ],
)
def test_coefficients_stand_for_the_effects_that_the_model_has(name: str, count: int) -> None:
    places = layout(with_temperature=True).places_of(effect(name).reference_terms)
    assert np.count_nonzero(places) == count
    # The open-circuit curve and the current itself belong to no effect.
    assert not places[: OCV_BUMPS + 8].any()


def test_without_a_temperature_nothing_stands_for_what_it_does() -> None:
    assert not layout().places_of(effect("entropic_voltage").reference_terms).any()


def test_relaxation_begins_at_a_hundred_seconds() -> None:
    plan = layout()
    fast = sum(tau_s < 100.0 for tau_s in TIME_CONSTANTS_S)
    assert np.flatnonzero(plan.places_of(effect("relaxation").reference_terms))[0] == plan.blocks[2 + fast].start


def test_the_current_is_scaled_by_temperature_only_where_the_shape_asks() -> None:
    current, warm = np.array([1.0, -2.0, 2.0]), np.array([25.0, 25.0, 35.0])
    assert layout().drive_A(current, warm) is current
    scaled = layout(shape=Shape(activation_K=2000.0)).drive_A(current, warm)
    np.testing.assert_allclose(scaled, [1.0, -2.0, 2.0 * np.exp(2000.0 * (1.0 / 308.15 - 1.0 / 298.15))], rtol=1e-12)


def test_signals_of_a_constant_current_settle_where_they_must() -> None:
    plan = layout(with_temperature=True)
    current, temperature = np.full(40_000, 1.5), np.full(40_000, 35.0)
    last = np.array([signal[-1] for signal in plan.signals(current, current, temperature)])
    currents = 1 + len(TIME_CONSTANTS_S)
    np.testing.assert_allclose(last[:currents], 1.5, rtol=1e-5)
    transfer = np.arcsinh(1.5 / (np.array(EXCHANGE_C_RATES) * CAPACITY_AH))
    np.testing.assert_allclose(last[currents : currents + 4], np.repeat(transfer, 2), rtol=1e-9)
    np.testing.assert_allclose(last[currents + 4 : currents + 7], 1.0, rtol=1e-9)
    warm = 1.5 * (1.0 / 308.15 - 1.0 / 298.15) * 3000.0
    np.testing.assert_allclose(last[currents + 7 :], [1.0, warm, warm], rtol=1e-9)


def test_every_signal_has_its_block() -> None:
    for with_temperature in (False, True):
        plan = layout(with_temperature)
        current = np.linspace(-1.0, 1.0, 50)
        assert len(plan.signals(current, current, np.full(50, 30.0))) == len(plan.blocks) - 1


def test_the_surface_runs_ahead_of_the_mean_state_of_charge() -> None:
    deep = layout(shape=Shape(depth=0.05, time_constant_s=10.0))
    current, warm = np.full(500, 1.0), np.full(500, 25.0)
    surface = deep.inputs(current, warm, np.array([499])).surface
    assert surface[0] == pytest.approx(0.05 * 1.0 / CAPACITY_AH, rel=1e-6)
    assert layout().inputs(current, warm, np.array([499])).surface[0] == 0.0


def test_a_curve_and_gains_times_the_regressors_are_the_voltage() -> None:
    plan = layout(shape=Shape(depth=0.05, time_constant_s=10.0))
    coefficients = np.zeros(plan.size)
    coefficients[plan.blocks[0].part] = 3.0 + 0.5 * plan.bases[OCV_BUMPS].centres
    coefficients[plan.blocks[1].part] = 0.03
    current, index = np.full(500, 1.0), np.array([498, 499])
    inputs = plan.inputs(current, np.full(500, 25.0), index)
    soc = np.array([0.4, 0.6])
    expected = 3.0 + 0.5 * (soc + 0.025) + 0.03
    np.testing.assert_allclose(plan.regressors(inputs, soc) @ coefficients, expected, atol=1e-9)


def test_penalties_are_on_roughness_and_on_the_size_of_gains() -> None:
    plan = layout()
    bent, first = np.zeros(plan.size), plan.blocks[0]
    bent[first.part] = np.arange(first.size, dtype=float) ** 2
    gains = np.zeros(plan.size)
    gains[plan.blocks[1].part] = 0.02
    curve, rough, large = plan.penalties()
    # Third differences of a parabola and second ones of a constant are nothing.
    assert bent @ curve @ bent == pytest.approx(0.0, abs=1e-6)
    assert gains @ rough @ gains == pytest.approx(0.0, abs=1e-15)
    # The size of eight gains of 0.02 Ohm in units of the capacity; the curve's size costs nothing.
    assert gains @ large @ gains == pytest.approx(8 * (0.02 * CAPACITY_AH) ** 2)
    assert bent @ large @ bent == 0.0 and bent @ rough @ bent == 0.0


def test_roughness_of_a_cubic_curve_is_its_third_difference() -> None:
    plan = layout()
    cubic, first = np.zeros(plan.size), plan.blocks[0]
    cubic[first.part] = np.arange(first.size, dtype=float) ** 3
    # 37 third differences of 6 each, for bumps four times as many as ten.
    assert cubic @ plan.penalties()[0] @ cubic == pytest.approx(4.0**5 * 37 * 36.0)
