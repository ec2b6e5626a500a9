from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.evidence.candidates import Comparison
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.evidence.forms import Form, Forms
from models.diagnosis.evidence.joint import with_form
from models.diagnosis.reference.samples import Samples
from models.effects import effect

N = 800
HYSTERESIS, RELAXATION, OFFSET = (effect(name) for name in ("hysteresis", "relaxation", "voltage_offset"))


@pytest.fixture
def comparison() -> Comparison:
    rng = np.random.default_rng(1)
    own = rng.standard_normal((N, 3))
    evidence = Evidence(np.zeros(N), own, np.eye(3), np.arange(N) // 40)
    return Comparison(Samples((), evidence.blocks), (), {}, evidence, 1e-4, 1e-4)


def with_error(comparison: Comparison, error_V: np.ndarray) -> Comparison:
    return replace(comparison, evidence=replace(comparison.evidence, error_V=error_V))


def test_costs_of_one_and_two_forms_are_those_of_the_joint_problem(comparison: Comparison) -> None:
    rng = np.random.default_rng(2)
    x, z, fixed = rng.standard_normal((N, 2)), rng.standard_normal((N, 1)), rng.standard_normal(N)
    against = with_error(comparison, x @ [1.0, -1.0] + 0.5 * z[:, 0] + 0.1 * rng.standard_normal(N))
    forms = Forms(against, (Form(HYSTERESIS, x, None, 2), Form(RELAXATION, z, fixed, 1)))
    assert forms.cost(0) == pytest.approx(against.evidence.solve(x).cost, rel=1e-4)
    target = against.evidence.error_V - fixed
    assert forms.cost(1) == pytest.approx(against.evidence.solve(z, target).cost, rel=1e-4)
    assert forms.cost(0, 1) == pytest.approx(against.evidence.solve(np.hstack([x, z]), target).cost, rel=1e-4)


def test_a_pair_is_found_that_a_mixture_of_both_hides(comparison: Comparison) -> None:
    rng = np.random.default_rng(3)
    one, other = rng.standard_normal((2, N))
    mixture = one + other + 0.3 * rng.standard_normal(N)
    against = with_error(comparison, one + other + 0.05 * rng.standard_normal(N))
    columns = {HYSTERESIS: one, RELAXATION: other, OFFSET: mixture}
    forms = Forms(against, tuple(Form(each, column[:, None], None, 1) for each, column in columns.items()))
    best_alone = min(range(3), key=forms.cost)
    assert forms.forms[best_alone].effect is OFFSET
    pair = forms.best_pair(price=0.01)
    assert pair is not None
    assert {forms.forms[number].effect for number in pair} == {HYSTERESIS, RELAXATION}


def test_a_form_in_the_model_leaves_what_the_pair_leaves(comparison: Comparison) -> None:
    rng = np.random.default_rng(4)
    x, z = rng.standard_normal((2, N, 1))
    against = with_error(comparison, (x + z)[:, 0] + 0.1 * rng.standard_normal(N))
    forms = Forms(against, (Form(HYSTERESIS, x, None, 1), Form(RELAXATION, z, None, 1)))
    wider = with_form(against, forms.forms[0])
    assert wider.evidence.solve(z).cost == pytest.approx(forms.cost(0, 1), rel=1e-3)


def test_what_an_inexact_model_leaves_is_not_held_against_an_effect(comparison: Comparison) -> None:
    rng = np.random.default_rng(5)
    z = rng.standard_normal((N, 1))
    against = with_error(comparison, z[:, 0] + 0.1 * rng.standard_normal(N))
    exact = Forms(against, (Form(RELAXATION, z, None, 1),))
    owed = Forms(against, (Form(RELAXATION, z, None, 1, inexact=1e9),))
    assert exact.judged(0.0, 0) == pytest.approx(exact.cost(0))
    # But never below the model's own error.
    assert owed.judged(0.0, 0) == pytest.approx(N * against.own_mse)
