"""Two effects at once, and when one alone is enough."""

import numpy as np
import pytest

from models.diagnosis.evidence.candidates import Comparison, try_effect
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.evidence.forms import Form
from models.diagnosis.evidence.joint import Named, best_form, named_effects, with_form
from models.diagnosis.evidence.ranking import rank
from models.effects import effect
from models.network.signals.direction import hysteresis_state
from tests.unit.models.diagnosis.hand_reference import compared, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH

CURRENT_A = steps_A(6000, largest_A=4.0, length=60)
LOOP_V = 0.01 * hysteresis_state(CURRENT_A, 110.0, 1.0, CAPACITY_AH)
NAMES = ("hysteresis", "series_resistance", "voltage_offset", "initial_soc")
NOISE_V = 5e-4


def against(added_V: np.ndarray | float) -> Comparison:
    run = true_run(CURRENT_A, added_V=added_V, noise_V=NOISE_V, seed=3)
    return compared(run, NAMES, own_mse=NOISE_V**2, noise_mse=NOISE_V**2)


def named(added_V: np.ndarray | float) -> tuple[Named, ...]:
    comparison = against(added_V)
    return named_effects(comparison, rank(comparison, [try_effect(comparison, each) for each in comparison.effects]))


def test_one_effect_stays_alone() -> None:
    assert [each.effect_name for each in named(0.004 * CURRENT_A)] == ["series_resistance"]


@pytest.mark.parametrize(("drop_Ohm", "first"), [(0.008, "series_resistance"), (0.002, "hysteresis")])
def test_two_effects_are_named_the_larger_first(drop_Ohm: float, first: str) -> None:
    found = named(LOOP_V + drop_Ohm * CURRENT_A)
    assert {each.effect_name for each in found} == {"hysteresis", "series_resistance"}
    assert found[0].effect_name == first
    assert found[0].ranking.size_V > found[1].ranking.size_V


def test_each_is_sized_beside_the_other() -> None:
    found = {each.effect_name: each for each in named(LOOP_V + 0.004 * CURRENT_A)}
    drop = found["series_resistance"].ranking.candidates[0]
    assert drop.solution.coefficients[0] == pytest.approx(0.004, rel=0.02)
    loop = found["hysteresis"].ranking.size_V
    assert loop == pytest.approx(float(np.sqrt(np.mean(LOOP_V**2))), rel=0.05)


def test_a_second_one_that_is_tiny_beside_the_first_is_left_unsaid() -> None:
    """An eighth of the larger is asked for: 0.5 mV beside 20 mV is not."""
    found = named(0.012 * CURRENT_A + 5e-4)
    assert [each.effect_name for each in found] == ["series_resistance"]


def test_a_second_one_has_to_be_worth_three_times_the_price_of_a_parameter() -> None:
    """In a short record with long blocks a slow loop beside a drop is hardly more than one of them."""
    current = steps_A(3000, largest_A=4.0, length=60)
    loop_V = 0.01 * hysteresis_state(current, 30.0, 1.0, CAPACITY_AH)
    run = true_run(current, added_V=loop_V + 0.008 * current, noise_V=NOISE_V, seed=3)
    comparison = compared(run, NAMES, own_mse=NOISE_V**2, noise_mse=NOISE_V**2)
    ranking = rank(comparison, [try_effect(comparison, each) for each in comparison.effects])
    forms, price = ranking.forms, ranking.price
    pair = forms.best_pair(price)
    assert pair is not None
    assert forms.cost(forms.best(ranking.candidates[0].effect, price)) - forms.cost(*pair) < 3.0 * price
    assert len(named_effects(comparison, ranking)) == 1


def test_an_effect_in_the_model_takes_its_own_part_in() -> None:
    comparison = against(LOOP_V + 0.004 * CURRENT_A)
    ranking = rank(comparison, [try_effect(comparison, effect("series_resistance"))])
    wider = with_form(comparison, best_form(ranking))
    p = comparison.evidence.regressors.shape[1]
    assert wider.evidence.regressors.shape[1] == p + 1
    np.testing.assert_array_equal(wider.evidence.information[:p, :p], comparison.evidence.information)
    # What is known of a free coefficient is next to nothing.
    assert wider.evidence.information[p, p] == pytest.approx(1e-6 * float(CURRENT_A @ CURRENT_A))
    # What is left is the loop, less the part of it that follows the current.
    left_V = LOOP_V - (LOOP_V @ CURRENT_A) / (CURRENT_A @ CURRENT_A) * CURRENT_A
    assert wider.evidence.cost == pytest.approx(float(left_V @ left_V), rel=0.02)


def test_what_is_fixed_of_a_form_is_taken_off_the_error() -> None:
    n = 200
    evidence = Evidence(np.full(n, 5e-3), np.zeros((n, 1)), np.eye(1), np.arange(n) // 20)
    comparison = Comparison(against(0.0).runs, (), {}, evidence, 1e-6, 1e-6)
    ramp = np.linspace(-1.0, 1.0, n)
    wider = with_form(comparison, Form(effect("capacity"), ramp[:, None], np.full(n, 3e-3), 1))
    np.testing.assert_allclose(wider.evidence.error_V, 2e-3)
