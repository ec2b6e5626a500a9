"""What is told of one run: named by the whole series, with sizes and words from the run."""

import time
from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.reference.record import Record
from models.diagnosis.trend.answer import answer, parts_V, where
from models.diagnosis.trend.estimate import Weighed, seen, weighed
from models.diagnosis.trend.weights.sizes import EVERY
from models.effects.view import View
from tests.unit.models.diagnosis.trend.test_estimate import discharge, whole
from tests.unit.models.hand_network import CAPACITY_AH

__all__ = ["whole"]


@pytest.fixture(scope="module")
def aged(whole) -> Weighed:  # noqa: ANN001, F811
    """10 % of the capacity lost, the resistance grown by more than half."""
    return weighed(seen(whole, discharge(0.9 * CAPACITY_AH, grown_Ohm=0.012), 1.0, 0.005))


def record_of(weighed: Weighed) -> Record:
    run, soc = weighed.given.run, weighed.given.soc
    view = View(weighed.given.known.cell, run, soc, np.arange(len(run)))
    return Record([run], [soc], [view.residual_V])


def chance(*likely: str) -> np.ndarray:
    return np.array([0.97 if each == likely else 0.03 / (len(EVERY) - 1) for each in EVERY])


def test_a_step_tells_grown_resistance_from_a_moved_curve(aged: Weighed) -> None:
    best = max(aged.chances.of, key=lambda each: aged.chances.of[each])
    assert "capacity" in best and aged.chances.that("resistance") > aged.chances.that("curve")


def test_what_was_found_takes_off_the_error_it_explains(aged: Weighed) -> None:
    record = record_of(aged)
    told = answer(aged, record, chance("capacity", "resistance"), True, time.perf_counter())
    assert told.verdict == "missing"
    assert [each.effect for each in told.findings] == ["capacity", "resistance_growth"]
    errors = [record.rms_mV, *(each.error_after_mV for each in told.findings)]
    assert errors[0] > 2.0 * errors[1] > 2.0 * errors[2]
    grown = told.findings[1].parameters["full_Ohm"]
    assert grown.value == pytest.approx(0.012, abs=2.0 * (grown.std or 0.0))
    assert told.findings[1].evidence["where"] in ("everywhere", "when full")
    assert told.findings[1].evidence["beside"] == ["capacity"]
    assert [each.evidence["takes_capacity"] for each in told.findings] == [True, False]


def test_what_is_hardly_likelier_than_not_beside_a_loss_is_said_and_not_named(aged: Weighed) -> None:
    both = np.where([each == ("capacity", "resistance") for each in EVERY], 0.55, 0.0)
    both += np.where([each == ("capacity",) for each in EVERY], 0.45, 0.0)
    told = answer(aged, record_of(aged), both, True, time.perf_counter())
    assert [each.effect for each in told.findings] == ["capacity"]
    assert told.remarks == ("resistance growth may have come as well, with 55 %",)


def test_a_curve_that_could_be_it_is_named_as_rival(aged: Weighed) -> None:
    both = np.where([each in (("curve",), ("resistance",)) for each in EVERY], 0.48, 0.04 / 6)
    told = answer(aged, record_of(aged), both, True, time.perf_counter())
    assert told.verdict == "ambiguous"
    (rival,) = told.findings[0].confounded_with
    assert {told.findings[0].effect, rival} == {"ocv_shape", "resistance_growth"}
    # The experiment that would settle it begins where the discharge has left the cell.
    asked = told.next_experiment
    assert asked is not None
    assert asked["rivals"] == [told.findings[0].effect, rival] and asked["criterion"] == "discriminate"
    assert asked["initial_soc"] == pytest.approx(0.0, abs=0.1)


def test_nothing_is_said_where_the_series_does_not_bear_it_out(aged: Weighed) -> None:
    told = answer(aged, record_of(aged), chance("capacity"), False, time.perf_counter())
    assert told.verdict == "nothing_missing" and told.findings == ()
    assert "expected by chance" in told.remarks[0]


def test_something_that_no_change_stands_for_is_unknown(aged: Weighed) -> None:
    odd = replace(aged, chances=replace(aged.chances, unknown=0.9, nothing=0.0, of=dict.fromkeys(EVERY[1:], 0.01)))
    assert answer(odd, record_of(aged), chance(), True, time.perf_counter()).verdict == "unknown_effect"


def test_parts_and_places(aged: Weighed) -> None:
    found = aged.told(("capacity", "resistance"))
    assert set(parts_V(aged, found)) == {"capacity", "resistance", "curve"}
    assert where(aged, found) in ("everywhere", "when full", "when empty", "in the middle")
