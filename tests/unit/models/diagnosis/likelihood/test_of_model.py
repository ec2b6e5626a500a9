"""What a model has of relaxations may grow, and its surface become slower: told as such, nothing that it lacks."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from models.diagnosis.known.fitting import fit_known
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.likelihood.analysis import Analysis, analyse
from models.diagnosis.likelihood.granted import granted, learned_columns
from models.diagnosis.likelihood.learning import know
from models.diagnosis.likelihood.shapes import Linear, shapes_of
from models.diagnosis.likelihood.sight import look
from models.effects import effect, effects
from models.effects.view import View
from models.identification.bounded.variants import Variant
from models.network.regression import SignalBank
from simulators.catalogue import CELLS
from tests.unit.models.effects.linear_cell import linear_view
from tests.unit.models.identification.bounded.bank import SLOW_SURFACE, SOC, bank, two_electrodes

SURFACE = (0.1, 268.0, 3500.0)
SLOPE_V = 0.8


def cell_of(surface: str = SLOW_SURFACE, seeds: tuple[int, ...] = (1, 2)) -> SignalBank:
    """Runs whose temperature is not looked at: it is that of another cell's losses."""
    two = two_electrodes(SLOPE_V, surface, seeds)
    return replace(two, runs=[replace(run, ambient_degC=None) for run in two.runs])


@cache
def trained() -> KnownRuns:
    two, form = cell_of(), Variant(SURFACE, behind=True)
    return know(two.runs, two.initial_soc, two.cell.capacity_Ah, list(effects().values()), form)


@cache
def judged(times: float) -> Analysis:
    """A further run of a cell whose slow electrode takes so many times as long to even out."""
    depth, tau_s, kelvin = SURFACE
    now = cell_of(f"surface_soc:{times * depth:g}/{times * tau_s:g}/{kelvin:g}", (3,))
    return analyse(trained(), now.runs, now.initial_soc, None, list(effects().values()))


def test_a_model_without_a_surface_has_none_to_be_slower() -> None:
    forms = effect("relaxation").expected.forms
    assert forms is not None
    *others, grown = forms(linear_view())
    assert not grown.columns.any()  # nor does this cell relax
    assert not any(form.of_model for form in others)


def test_slow_resistances_grow_together() -> None:
    relaxing = bank(CELLS["nmc"].parameters, n=6000)
    cell, _ = fit_known(relaxing.runs, relaxing.initial_soc, relaxing.cell.capacity_Ah, Variant(), starts_known=True)
    view = View(cell, relaxing.runs[0], SOC, np.arange(0, 6000, 7))
    forms = effect("relaxation").expected.forms
    assert forms is not None
    *_, grown = forms(view)
    soc = view.soc[view.index]
    np.testing.assert_array_equal(grown.columns[:, 0], cell.slow_V(view.inputs, soc))
    # It begins with nothing, follows the current by minutes, and is told as a resistance of its size.
    slow_A = view.low_pass(view.run.current_A, grown.fixed[0][2])
    assert np.corrcoef(grown.columns[:, 0], slow_A)[0, 1] > 0.9
    assert grown.told[0].weights[0] == pytest.approx(grown.columns[:, 0] @ slow_A / (slow_A @ slow_A))
    assert grown.told[0].weights[0] > 0.0


def test_a_slower_surface_is_the_voltage_of_a_cell_that_has_it() -> None:
    cell, now = trained().cell, cell_of("surface_soc:0.3/804/3500", (3,))
    view = View(cell, now.runs[0], now.initial_soc[0], np.arange(0, 6000, 7))
    np.testing.assert_array_equal(view.slowed_V(1.0), 0.0)
    off_V = view.residual_V
    assert np.sqrt(np.mean((off_V - view.slowed_V(3.0)) ** 2)) < 0.4 * np.sqrt(np.mean(off_V**2))


def test_it_is_named_with_its_time_and_explains_the_run() -> None:
    analysis = judged(3.0)
    (found,) = analysis.named
    assert found.effect.name == "relaxation"
    assert isinstance(found.shape, Linear)
    assert found.shape.of_model
    ((_, _, tau_s),) = found.shape.fixed
    assert tau_s == pytest.approx(804.0, rel=0.4)
    left_V = (analysis.back.error - analysis.explained)[: analysis.sight.n_voltage]
    assert np.sqrt(np.mean(left_V**2)) < 0.4 * np.sqrt(np.mean(analysis.back.error[: analysis.sight.n_voltage] ** 2))


def test_a_cell_as_it_was_has_nothing_new() -> None:
    assert not judged(1.0).named


def test_what_the_training_runs_tell_is_neither_lacking_nor_comes_and_goes() -> None:
    now = cell_of(seeds=(3,))
    sight, one = look(trained(), now.runs, now.initial_soc), effect("relaxation")
    shapes = shapes_of(sight, one)
    others = tuple(each for each in shapes if not (isinstance(each, Linear) and each.of_model))
    assert 0 < len(others) < len(shapes)
    learned = learned_columns(sight, {one.name: shapes})[one.name]
    np.testing.assert_array_equal(learned, learned_columns(sight, {one.name: others})[one.name])
    # But they know the surface's time to a tenth only.
    every, known = (granted(sight, {one.name: each}) for each in (shapes, others))
    np.testing.assert_array_equal(every[:, :-1], known)
    (nearest,) = (each for each in shapes if isinstance(each, Linear) and each.untold)
    np.testing.assert_allclose(every[:, -1], nearest.untold * nearest.columns[:, 0])
    assert nearest.untold * np.log(1.6) == pytest.approx(0.1, abs=0.02)
