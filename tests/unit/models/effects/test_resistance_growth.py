"""Growth of the resistance: in which runs it can be told from a resistance over the state of charge."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.timeseries import FloatArray
from models.effects import effect
from models.effects.view import View
from tests.unit.models.effects.linear_cell import RESISTANCE_OHM, linear_view

N = 6000
EFFECT = effect("resistance_growth")
FALLING = np.random.default_rng(2).uniform(-2.0, 0.3, N // 30).repeat(30)
SWINGING = 1.2 * np.sin(np.arange(N) / 190.0) + 0.5 * np.sin(np.arange(N) / 13.0)


def played(current_A: FloatArray) -> View:
    plain = linear_view(n=N)
    run = replace(plain.run, current_A=current_A, charge_Ah=np.cumsum(current_A) / 3600.0)
    return View(plain.model, run, 0.9, np.arange(0, N, 5))


@pytest.mark.parametrize(
    ("runs", "told"),
    [
        ([FALLING], False),
        # Another discharge is the same once more: nobody says what has passed between them.
        ([FALLING, 0.7 * FALLING], False),
        # Nor does it help to charge once: in that direction the resistance may be another.
        ([np.concatenate([FALLING[::2], -FALLING[::-2]])], False),
        ([np.zeros(N)], False),
        ([np.full(N, 1e-9)], False),
        ([SWINGING], True),
        ([SWINGING, FALLING], True),
    ],
)
def test_it_is_told_where_the_state_of_charge_comes_back(runs: list[FloatArray], told: bool) -> None:
    assert EFFECT.tells([played(each) for each in runs]) is told


def test_any_runs_tell_most_other_effects() -> None:
    assert effect("hysteresis").tells([played(FALLING)])


def test_what_it_makes_of_the_voltage_grows_with_the_charge_that_has_passed() -> None:
    view = played(SWINGING)
    assert EFFECT.fault_V is not None
    passed_Ah = np.cumsum(np.abs(SWINGING)) / 3600.0
    expected = (0.05 * RESISTANCE_OHM * passed_Ah * SWINGING)[view.index]
    np.testing.assert_allclose(EFFECT.fault_V(view, {"growth_per_Ah": 0.05}), expected, atol=1e-12)
    later = replace(view, passed_Ah=2.0)
    more = expected + (0.05 * RESISTANCE_OHM * 2.0 * SWINGING)[view.index]
    np.testing.assert_allclose(EFFECT.fault_V(later, {"growth_per_Ah": 0.05}), more, atol=1e-12)


def test_a_film_that_lets_ever_less_through_grows_with_the_root_of_the_charge() -> None:
    view = played(SWINGING)
    assert EFFECT.expected.forms is not None and EFFECT.fault_V is not None
    steady, slowing = EFFECT.expected.forms(view)
    passed_Ah = np.cumsum(np.abs(SWINGING)) / 3600.0
    mean, usual_Ah = 0.02, 5.0 * view.capacity_Ah
    for form, growth in ((steady, mean * passed_Ah), (slowing, mean * np.sqrt(passed_Ah * usual_Ah))):
        size = mean / form.told[0].weights[0]
        expected = (RESISTANCE_OHM * growth * SWINGING)[view.index]
        np.testing.assert_allclose(size * form.columns[:, 0], expected, atol=1e-12)
        # What is told of it is what is taken out of a run again.
        told = {"growth_per_Ah": mean, **{name: value for name, _, value in form.fixed}}
        np.testing.assert_allclose(EFFECT.fault_V(view, told), expected, atol=1e-12)
    assert np.isfinite(EFFECT.expected.forms(played(np.zeros(N)))[1].columns).all()
