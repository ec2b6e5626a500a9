"""What every physical effect owes, whichever there are; and that nothing outside its file knows one by its name."""

import ast
import importlib
import math
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import bench_service
import models
import models.effects
from bench_service.campaign.diagnosing import catalogue
from models.effects import Effect, effect, effects
from models.effects.effect import Variable
from models.effects.reading import Assumption, Reading
from models.effects.view import ReferenceTerm, View
from models.effects.ways_in import Ground
from models.network.structure import minimal_structure
from tests.unit.models.effects.linear_cell import CAPACITY_AH, linear_view, thermal_view

PUBLIC = Path(__file__).with_name("effect_names.txt").read_text(encoding="utf-8").split()
EVERY = sorted(effects())
# What the package is made of besides.
FRAMEWORK = {
    "bent_curve",
    "bounded_parts",
    "contact_intervals",
    "effect",
    "electrode_match",
    "electrode_shift",
    "expected",
    "half_cell_curves",
    "half_cells",
    "input_correction",
    "once_a_model",
    "own_electrodes",
    "reading",
    "spline",
    "thermal_view",
    "view",
    "ways_in",
}
# These words mean something else as well: a field of a request, a kind of signal, a term of a model.
OTHER_MEANINGS = {"capacity", "initial_soc", "hysteresis", "relaxation", "charge_transfer"}
GROUND = Ground(CAPACITY_AH, 1.5, 3000.0, ((0.0,), (2500.0,), (0.0, 5000.0)))


def having(field: str) -> list[str]:
    return [name for name in EVERY if getattr(effect(name), field)]


@pytest.fixture(scope="module")
def view() -> View:
    return linear_view()


def test_the_names_of_the_public_contract_are_there() -> None:
    assert len(PUBLIC) == len(set(PUBLIC)) > 0
    assert set(PUBLIC) <= set(effects())


def test_a_file_holds_the_effect_of_its_name() -> None:
    for module in pkgutil.iter_modules(models.effects.__path__):
        found = getattr(importlib.import_module(f"models.effects.{module.name}"), "EFFECT", None)
        if module.name not in FRAMEWORK:
            assert isinstance(found, Effect), f"models/effects/{module.name}.py has no EFFECT"
            assert found.name == module.name


def own_files() -> Iterator[Path]:
    for package in (models, bench_service):
        yield from (path for each in package.__path__ for path in Path(each).rglob("*.py"))


def test_no_other_file_knows_an_effect_by_its_name() -> None:
    names = set(EVERY) - OTHER_MEANINGS
    homes = [Path(each) for each in models.effects.__path__]
    for path in own_files():
        text = path.read_text(encoding="utf-8")
        if path.parent not in homes and any(name in text for name in names):
            words = {each.value for each in ast.walk(ast.parse(text)) if isinstance(each, ast.Constant)}
            assert not words & names, path
    for path in (Path(bench_service.__path__[0]) / "web" / "static").glob("*.js"):
        assert not set(re.findall(r"\w+", path.read_text(encoding="utf-8"))) & names, path


@pytest.mark.parametrize("name", EVERY)
def test_it_says_what_a_person_needs(name: str) -> None:
    found = effect(name)
    assert found.name == name
    assert found.title and len(found.recognise) > 30 and found.source
    assert found.parameters and all(each.unit and each.meaning for each in found.parameters)
    assert found.shows_over and set(found.shows_over) <= set(get_args(Variable))


@pytest.mark.parametrize("name", EVERY)
def test_it_shows_somewhere(name: str) -> None:
    found = effect(name)
    assert (found.regressors is None) == (found.channel == "temperature")
    assert found.regressors is not None or found.warmth is not None
    assert sum(form is not None for form in (found.shift, found.lean, found.local)) <= 1
    assert set(found.reference_terms) <= set(get_args(ReferenceTerm))


@pytest.mark.parametrize("name", EVERY)
def test_its_relations_name_effects_and_hold_both_ways(name: str) -> None:
    found = effect(name)
    assert set(found.contains) | set(found.part_of) | set().union(*found.seems) <= set(effects())
    assert name not in found.contains and name not in set().union(*found.seems)
    assert all(name in effect(each).contains for each in found.part_of)
    assert found.twin is None or effect(found.twin).twin == name
    if found.heats_as is not None:
        heat = effect(found.heats_as)
        assert heat.warmth is not None and found.lean is not None
        assert heat.parameters[0].unit == found.parameters[0].unit


@pytest.mark.parametrize("name", EVERY)
def test_the_service_tells_it_to_programs_and_to_the_page(name: str) -> None:
    told = {each["name"]: each for each in catalogue()}[name]
    found = effect(name)
    assert told["title"] == found.title
    assert told["shows_over"] == list(found.shows_over)
    assert {each["name"]: each["unit"] for each in told["parameters"]} == {p.name: p.unit for p in found.parameters}


@pytest.mark.parametrize("name", having("regressors"))
def test_regressors_are_finite_and_not_empty(name: str, view: View) -> None:
    regressors = effect(name).regressors
    assert regressors is not None
    x = regressors(view)
    assert x.shape[0] == len(view.index)
    assert np.isfinite(x).all()
    assert np.abs(x).max() > 0.0


@pytest.mark.parametrize("name", having("shift"))
def test_a_shift_begins_at_nothing(name: str, view: View) -> None:
    shift = effect(name).shift
    assert shift is not None
    low, high = shift.limits(view)
    assert low < 0.0 < high and 0.0 < shift.step(view) < high
    np.testing.assert_allclose(shift.voltage(view, 0.0), 0.0, atol=1e-12)
    assert np.abs(shift.voltage(view, shift.step(view))).max() > 0.0
    assert math.isfinite(shift.physical(view, shift.step(view)))


@pytest.mark.parametrize("name", having("lean"))
def test_the_smallest_form_is_finite_over_all_shapes(name: str, view: View) -> None:
    lean = effect(name).lean
    assert lean is not None
    shapes = lean.shapes(view)
    assert len(shapes) == 1 or len(effect(name).parameters) > 1
    for shape in shapes:
        x = lean.columns(view, shape)
        assert x.shape[0] == len(view.index) and np.isfinite(x).all() and np.abs(x[:, 0]).max() > 0.0


@pytest.mark.parametrize("name", having("local"))
def test_a_local_size_is_that_of_the_regressors(name: str, view: View) -> None:
    found = effect(name)
    assert found.local is not None and found.regressors is not None
    assert found.regressors(view).shape[1] == found.local.size


@pytest.mark.parametrize("name", having("warmth"))
def test_a_temperature_begins_where_the_balance_has_it(name: str) -> None:
    found, view = effect(name), thermal_view()
    warmth = found.warmth
    assert warmth is not None
    assert len(warmth.start) == len(warmth.step) == len(warmth.physical(view, warmth.start)) == len(found.parameters)
    np.testing.assert_allclose(warmth.temperature(view, warmth.start), view.simulated(), atol=1e-9)
    for i, step in enumerate(warmth.step):
        moved = (*warmth.start[:i], warmth.start[i] + step, *warmth.start[i + 1 :])
        assert np.abs(warmth.temperature(view, moved) - view.simulated()).max() > 0.0


@pytest.mark.parametrize("name", having("extend"))
def test_an_extended_structure_differs_and_reads_back(name: str) -> None:
    extend = effect(name).extend
    assert extend is not None
    before = minimal_structure(1.0, output_order=0)
    after = extend(before, {}, CAPACITY_AH)
    assert after != before
    assert type(after).from_json(after.to_json()) == after


@pytest.mark.parametrize("name", having("ways_in"))
def test_every_step_of_a_richer_way_ends_in_a_structure_that_reads_back(name: str) -> None:
    found, structure = effect(name), minimal_structure(1.0)
    assert found.extend is not None
    for step in found.ways_in:
        tried = step.structures(structure, GROUND)
        assert tried and all(each != structure for each in tried[1:])
        assert all(type(each).from_json(each.to_json()) == each for each in tried)
        structure = tried[-1]


@pytest.mark.parametrize("name", having("correction"))
def test_a_correction_needs_no_more_than_the_parameters(name: str) -> None:
    found = effect(name)
    correction = found.correction
    assert correction is not None and (correction.sample is not None or correction.delay_s is not None)
    values = {each.name: 0.5 for each in found.parameters}
    assert correction.possible(values)
    read = Reading(1.0, 3.7, 25.0, 20.0)
    if correction.sample is not None:
        one = correction.sample(read, values)
        assert one != read
        # A run's columns are corrected as its samples are.
        both = correction.sample(Reading(*(np.array([each, each]) for each in read)), values)
        np.testing.assert_array_equal(np.array(both)[:, 1], np.array(one))
    if correction.delay_s is not None:
        assert math.isfinite(correction.delay_s(values))


@pytest.mark.parametrize("name", having("assumption"))
def test_an_assumption_is_read_from_the_parameters(name: str) -> None:
    found = effect(name)
    assert found.assumption is not None and found.assumption != Assumption()
    values = {each.name: 0.5 for each in found.parameters}
    if found.assumption.capacity_Ah is not None:
        assert math.isfinite(found.assumption.capacity_Ah(values))
    if found.assumption.soc_moved is not None:
        assert found.assumption.soc_moved(values, 0.4) == pytest.approx(0.1)


@pytest.mark.parametrize("name", having("activation_K"))
def test_an_activation_is_read_from_the_parameters(name: str) -> None:
    found = effect(name)
    assert found.activation_K is not None
    assert math.isfinite(found.activation_K({each.name: 0.5 for each in found.parameters}))


@pytest.mark.parametrize("name", having("inner_heat_W"))
def test_an_inner_heat_is_that_of_one_unit_of_a_shift(name: str) -> None:
    found = effect(name)
    assert found.inner_heat_W is not None and found.shift is not None
    heat_W = found.inner_heat_W(np.array([3.2, 3.7]))
    assert heat_W.shape == (2,) and np.isfinite(heat_W).all()
