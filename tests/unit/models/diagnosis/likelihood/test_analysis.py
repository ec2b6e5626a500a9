"""What is named of one effect and two that are nearly as likely, and what may have been in its place."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from models.diagnosis.likelihood.analysis import Analysis
from models.diagnosis.likelihood.background import Background, Weighed
from models.diagnosis.likelihood.tried import Tried
from models.diagnosis.likelihood.verdict import Verdict
from models.effects import effect
from tests.unit.models.effects.linear_cell import linear_view

NOTHING: Any = None


def tried(name: str, log_likelihood: float) -> Tried:
    weighed = Weighed(log_likelihood, np.ones(1), np.eye(1))
    return Tried(effect(name), NOTHING, np.zeros((4, 1)), None, weighed)


@pytest.mark.parametrize(("share", "rival"), [(0.9, True), (0.6, True), (0.4, False)])
def test_a_loop_that_explains_half_of_a_free_curve_is_its_rival(share: float, rival: bool) -> None:
    curve, loop, other = tried("ocv_shape", 100.0), tried("hysteresis", 100.0 * share), tried("relaxation", 90.0)
    verdict = Verdict(0.0, 0.0, ((1.0, curve), (0.0, loop), (0.0, other)), ())
    analysis = Analysis(NOTHING, NOTHING, (curve, loop, other), verdict)
    assert analysis.named == (curve,)
    assert [each.effect.name for each in analysis.one_curve] == (["hysteresis"] if rival else [])


@pytest.mark.parametrize(
    ("one", "two", "named", "rivals"),
    [
        (0.3, 0.5, ["current_gain"], ["capacity", "temperature_sensor"]),  # likelier, but not by a factor of two
        (0.5, 0.3, ["current_gain"], []),
        (0.2, 0.6, ["temperature_sensor", "capacity"], ["current_gain"]),
        (0.02, 0.9, ["temperature_sensor", "capacity"], []),
    ],
)
def test_two_effects_stand_in_the_place_of_one_only_where_they_are_clearly_likelier(
    one: float, two: float, named: list[str], rivals: list[str]
) -> None:
    gain, lost, sensor = tried("current_gain", 50.0), tried("capacity", 15.0), tried("temperature_sensor", 37.0)
    every = (gain, lost, sensor)
    verdict = Verdict(0.0, 0.0, ((one, gain), (0.0, lost), (0.0, sensor)), ((two, lost, sensor),))
    sight: Any = SimpleNamespace(n_voltage=4)
    analysis = Analysis(sight, Background(np.zeros(4), np.eye(4), np.eye(4)), every, verdict)
    assert [each.effect.name for each in analysis.named] == named
    assert [each.effect.name for each in analysis.rivals] == rivals


def test_a_loop_may_be_wide_near_empty_alone() -> None:
    view = linear_view()
    forms = effect("hysteresis").expected.forms
    assert forms is not None
    silicon = [each for each in forms(view) if ("amplitude_at_soc", "1", 0.1) in each.fixed]
    assert len(silicon) == 3
    assert {each.told[0].name for each in forms(view)} == {"amplitude_V"}
    for form in silicon:
        loop = form.columns[:, 0] / view.hysteresis(form.fixed[0][2])
        soc = view.soc[view.index]
        usual_V = form.told[0].weights[0]
        np.testing.assert_allclose(loop, usual_V * np.exp((0.1 - soc) / 0.1), rtol=1e-9)


@pytest.mark.parametrize(("entropy", "rivals"), [(95.0, ["entropic_voltage"]), (60.0, []), (150.0, [])])
def test_an_entropy_is_a_rival_of_its_heat_in_a_pair_too(entropy: float, rivals: list[str]) -> None:
    heat, sensor, cause = (
        tried("reversible_heat", 100.0),
        tried("temperature_sensor", 3.0),
        tried("entropic_voltage", entropy),
    )
    verdict = Verdict(0.0, 0.0, ((0.0, heat), (0.0, cause), (0.0, sensor)), ((0.9, heat, sensor),))
    sight: Any = SimpleNamespace(n_voltage=4)
    back = Background(np.zeros(4), np.eye(4), np.eye(4))
    analysis = Analysis(sight, back, (heat, sensor, cause), verdict)
    assert [each.effect.name for each in analysis.named] == ["reversible_heat", "temperature_sensor"]
    assert [each.effect.name for each in analysis.rivals] == rivals


@pytest.mark.parametrize(
    ("sure", "second", "rival"),
    [
        (False, "voltage_offset", True),
        (False, "voltage_gain", True),
        (True, "voltage_offset", False),
        (False, "relaxation", False),
    ],
)
def test_lost_lithium_of_unknown_electrodes_may_be_a_start_elsewhere_beside_an_offset(
    monkeypatch: pytest.MonkeyPatch, sure: bool, second: str, rival: bool
) -> None:
    start, other, lithium = tried("initial_soc", 90.0), tried(second, 40.0), tried("lithium_loss", 3.0)
    every, alone = (start, other, lithium), ((0.0, start), (0.0, other), (0.0, lithium))
    verdict = Verdict(0.0, 0.0, alone, ((0.9, start, other),))
    sight: Any = SimpleNamespace(n_voltage=4, known=SimpleNamespace(cell=NOTHING))
    monkeypatch.setattr("models.diagnosis.likelihood.analysis.half_cells", lambda _cell: SimpleNamespace(sure=sure))
    analysis = Analysis(sight, Background(np.zeros(4), np.eye(4), np.eye(4)), every, verdict)
    assert [each.effect.name for each in analysis.named] == ["initial_soc", second]
    assert [each.effect.name for each in analysis.rivals] == (["lithium_loss"] if rival else [])


@pytest.mark.parametrize(
    ("sure", "second", "confidence"),
    [(False, "capacity", 0.6), (True, "capacity", 0.9), (False, None, 0.6), (True, None, 0.9)],
)
def test_a_curve_that_an_unknown_electrode_may_have_bent_is_not_sure_beside_another_effect_either(
    monkeypatch: pytest.MonkeyPatch, sure: bool, second: str | None, confidence: float
) -> None:
    curve, lost, material = tried("ocv_shape", 100.0), tried("capacity", 20.0), tried("active_material_loss", 40.0)
    every = (curve, lost, material)
    alone, pairs = ((0.0, curve), (0.0, lost), (0.0, material)), ((0.9, curve, lost),)
    verdict = Verdict(0.0, 0.0, alone, pairs) if second else Verdict(0.0, 0.0, ((0.9, curve), *alone[1:]), ())
    sight: Any = SimpleNamespace(n_voltage=4, known=SimpleNamespace(cell=NOTHING))
    monkeypatch.setattr("models.diagnosis.likelihood.analysis.half_cells", lambda _cell: SimpleNamespace(sure=sure))
    analysis = Analysis(sight, Background(np.zeros(4), np.eye(4), np.eye(4)), every, verdict)
    assert len(analysis.named) == (2 if second else 1) and analysis.named[0] is curve
    assert analysis.confidence == pytest.approx(confidence)
