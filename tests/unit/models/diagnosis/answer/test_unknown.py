"""What an error that no known effect explains is said to depend on."""

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.diagnosis.answer.unknown import depends_on
from models.diagnosis.reference.reference import fit_reference
from models.effects.view import View
from tests.unit.models.diagnosis.cells import SOC, bare, measured


@pytest.fixture(scope="module")
def view() -> View:
    run = to_grid(measured(bare(), 3), 1.0)
    return View(fit_reference([run], [SOC], 2.5), run, SOC, np.arange(len(run)))


def test_a_variable_that_predicts_the_error_comes_first(view: View) -> None:
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(view.index))
    found = depends_on((view,), 1e-3 * (view.soc - 0.5) ** 2 * 8.0 + noise)
    assert found[0][0] == "soc" and found[0][1] > 0.5


def test_where_nothing_predicts_it_is_told_where_the_error_is_large(view: View) -> None:
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(view.index))
    charging = view.run.current_A > np.quantile(view.run.current_A, 0.85)
    found = depends_on((view,), np.where(charging, 5.0, 1.0) * noise)
    assert found[0][0] == "current_A" and 0.4 < found[0][1] < 0.9


def test_noise_depends_on_nothing(view: View) -> None:
    assert depends_on((view,), 1e-3 * np.random.default_rng(2).standard_normal(len(view.index))) == ()
    assert depends_on((view,), np.zeros(len(view.index))) == ()
