"""Verdict, findings and remarks of a change, from analyses whose probabilities are put together here."""

import time
from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.diagnosis.answer.change_answer import change_answer
from models.diagnosis.answer.confidence import SURE_ELSEWHERE
from models.diagnosis.answer.findings import Diagnosis, Finding
from models.diagnosis.likelihood.analysis import Analysis, analyse
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.reference.record import Record
from models.diagnosis.thermal.heat_balance import HeatBalance
from models.effects import effect
from tests.unit.models.diagnosis.known.hand_cell import SOC, known_runs, steps_A, true_run

CURRENT_A = steps_A(3000, largest_A=4.0)
NAMES = ("series_resistance", "voltage_offset", "current_offset", "self_discharge")


@pytest.fixture(scope="module")
def new_contact() -> tuple[Analysis, Record]:
    return analysed(0.01 * CURRENT_A)


@pytest.fixture(scope="module")
def as_before() -> tuple[Analysis, Record]:
    return analysed(0.0)


def analysed(added_V: np.ndarray | float) -> tuple[Analysis, Record]:
    """A run with something on top, whose network's error is the known cell's."""
    run: GridRun = true_run(CURRENT_A, added_V=added_V, noise_V=5e-4)
    analysis = analyse(known_runs(), [run], [SOC], None, [effect(name) for name in NAMES])
    points = analysis.sight.runs[0].every
    return analysis, Record([run], [SOC], [points.residual_V])


def answered(analysis: Analysis, record: Record, has_train: bool = True) -> Diagnosis:
    return change_answer(analysis, record, time.perf_counter(), has_train)


def test_a_named_effect_is_missing_with_its_figures(new_contact: tuple[Analysis, Record]) -> None:
    answer = answered(*new_contact)
    (first,) = answer.findings
    assert (answer.verdict, answer.mode, first.effect, first.rank) == ("missing", "change", "series_resistance", 1)
    before_mV = 1e3 * float(np.sqrt(np.mean((0.01 * CURRENT_A) ** 2)))
    assert first.error_before_mV == pytest.approx(before_mV, rel=0.1)
    assert first.error_after_mV == answer.unexplained_mV < 0.2 * before_mV
    value = first.parameters["resistance_Ohm"]
    assert value.std is not None and value.value == pytest.approx(0.01, abs=2.5 * value.std)
    assert first.confidence > 0.8
    assert answer.hides_best == ()
    assert first.evidence["probability_of_nothing"] < 0.05


def test_nothing_new_is_nothing_missing_and_says_what_could_hide(as_before: tuple[Analysis, Record]) -> None:
    answer = answered(*as_before)
    assert (answer.verdict, answer.findings, answer.next_experiment) == ("nothing_missing", (), None)
    assert {each.effect for each in answer.power} == set(NAMES)
    assert all(each.size is not None and each.size > 0.0 for each in answer.power)
    assert len(answer.hides_best) == 3
    assert "could hide best" in answer.remarks[-1]


def test_something_that_no_effect_explains_is_unknown(as_before: tuple[Analysis, Record]) -> None:
    analysis, record = as_before
    verdict = replace(analysis.verdict, nothing=0.01, unknown=0.9)
    answer = answered(replace(analysis, verdict=verdict), record)
    assert (answer.verdict, answer.findings) == ("unknown_effect", ())


def test_rivals_make_it_ambiguous_and_ask_for_an_experiment(as_before: tuple[Analysis, Record]) -> None:
    analysis, record = as_before
    tried = {each.effect.name: each for each in analysis.tried}
    single = ((0.5, tried["series_resistance"]), (0.3, tried["voltage_offset"]), (0.01, tried["current_offset"]))
    answer = answered(replace(analysis, verdict=replace(analysis.verdict, nothing=0.01, single=single)), record)
    assert answer.verdict == "ambiguous"
    assert [each.effect for each in answer.findings] == ["series_resistance", "voltage_offset"]
    assert [each.rank for each in answer.findings] == [1, 2]
    assert answer.findings[0].confounded_with == ("voltage_offset",)
    request = answer.next_experiment
    assert request is not None and request["rivals"] == ["series_resistance", "voltage_offset"]


@pytest.mark.parametrize(("off_V", "most"), [(5e-4, 1.0), (5e-3, 0.85)])
def test_nothing_is_sure_where_the_cell_is_hardly_known(
    new_contact: tuple[Analysis, Record], off_V: float, most: float
) -> None:
    analysis, record = new_contact
    known = analysis.sight.known
    elsewhere = replace(known.elsewhere, unseen_V=np.full(len(known.elsewhere.unseen_V), off_V), own_V2=0.0)
    found = replace(analysis, sight=replace(analysis.sight, known=replace(known, elsewhere=elsewhere)))
    assert answered(found, record).findings[0].confidence == pytest.approx(min(analysis.confidence, most))


def test_twins_name_each_other_however_sure_one_is(as_before: tuple[Analysis, Record]) -> None:
    analysis, record = as_before
    tried = {each.effect.name: each for each in analysis.tried}
    single = ((0.9, tried["current_offset"]), (1e-6, tried["self_discharge"]))
    answer = answered(replace(analysis, verdict=replace(analysis.verdict, nothing=0.01, single=single)), record)
    assert answer.findings[0].confounded_with == ("self_discharge",)


def test_remarks_say_what_was_left_out_and_what_was_missing(as_before: tuple[Analysis, Record]) -> None:
    analysis, record = as_before
    part = replace(analysis, sight=replace(analysis.sight, share_inside=0.6))
    remarks = answered(part, record, has_train=False).remarks
    assert remarks[0] == "40 % of the samples lie outside the trained state of charge"
    assert "without the training runs" in remarks[-1]


def test_what_the_temperature_alone_shows_is_said_not_to_be_asked_about(as_before: tuple[Analysis, Record]) -> None:
    analysis, record = as_before
    told = next(each for each in answered(analysis, record).remarks if "temperature is not looked at" in each)
    assert "cooling of the cell, reversible heat, wrong temperature reading" in told
    assert "fit it again" in told
    sight = analysis.sight
    balanced = replace(sight, known=replace(sight.known, balance=HeatBalance(8.0, 600.0, 0.0, 0.0)))
    told = next(
        each
        for each in answered(replace(analysis, sight=balanced), record).remarks
        if "temperature is not looked at" in each
    )
    assert "diagnosed runs lack" in told


def test_a_network_far_coarser_than_what_is_known_is_told_so(as_before: tuple[Analysis, Record]) -> None:
    analysis, record = as_before
    coarse = replace(record, error_V=[record.error_V[0] + 0.05])
    assert any("most of it is the network's own" in each for each in answered(analysis, coarse).remarks)


def test_a_curve_that_two_errors_bend_together_is_told_beside_them_and_nobody_is_sure() -> None:
    names = ("ocv_shape", "voltage_offset", "initial_soc")
    run: GridRun = true_run(CURRENT_A, added_V=0.01, noise_V=5e-4)
    analysis = analyse(known_runs(), [run], [SOC], None, [effect(name) for name in names])
    curve, offset, start = (next(each for each in analysis.tried if each.effect.name == name) for name in names)
    curve = replace(curve, weighed=replace(curve.weighed, log_likelihood=2.0 * THRESHOLDS.asked))
    pairs = ((0.99, offset, start),)
    verdict = replace(analysis.verdict, nothing=0.0, single=((0.01, offset),), pairs=pairs)
    both = replace(analysis, tried=(curve, offset, start), verdict=verdict)
    assert {each.effect.name for each in both.named} == {"voltage_offset", "initial_soc"}
    assert "ocv_shape" in {each.effect.name for each in both.rivals}
    assert both.confidence == THRESHOLDS.sure_of_curve


def test_a_free_curve_is_not_sure_where_an_electrode_of_unknown_material_may_have_bent_it() -> None:
    names = ("ocv_shape", "lithium_loss")
    run: GridRun = true_run(CURRENT_A, noise_V=5e-4)
    analysis = analyse(known_runs(), [run], [SOC], None, [effect(name) for name in names])
    curve, lithium = (next(each for each in analysis.tried if each.effect.name == name) for name in names)
    verdict = replace(analysis.verdict, nothing=0.0, single=((0.99, curve), (0.01, lithium)), pairs=())

    def confidence(log_likelihood: float) -> float:
        own = replace(lithium, weighed=replace(lithium.weighed, log_likelihood=log_likelihood))
        free = replace(curve, weighed=replace(curve.weighed, log_likelihood=100.0))
        found = replace(verdict, single=((0.99, free), (0.01, own)))
        return replace(analysis, tried=(free, own), verdict=found).confidence

    assert confidence(0.5 * THRESHOLDS.asked) == 0.99
    assert confidence(1.5 * THRESHOLDS.asked) == THRESHOLDS.sure_of_curve


def test_errors_that_are_not_white_are_not_known_to_the_noise(new_contact: tuple[Analysis, Record]) -> None:
    analysis, record = new_contact
    known = analysis.sight.known
    share = known.elsewhere.white_share
    off = replace(known, elsewhere=replace(known.elsewhere, own_V2=float(np.mean(known.elsewhere.unseen_V**2))))
    assert 0.0 < off.elsewhere.white_share < 0.5 * (1.0 + share)
    doubtful = replace(analysis, sight=replace(analysis.sight, known=off))
    assert answered(doubtful, record).findings[0].confidence <= SURE_ELSEWHERE


def test_a_lost_capacity_is_told_before_a_cause_that_explains_hardly_more(as_before: tuple[Analysis, Record]) -> None:
    analysis, record = as_before
    loss, whole, *_ = analysis.tried
    loss = replace(loss, effect=replace(loss.effect, causes=("lithium",)))
    whole = replace(whole, effect=replace(whole.effect, life="capacity"))

    def first(of_whole: float) -> Finding:
        verdict = replace(analysis.verdict, nothing=0.01, single=((0.6, loss), (of_whole, whole)), pairs=())
        answer = answered(replace(analysis, tried=(loss, whole), verdict=verdict), record)
        return answer.findings[0]

    assert (first(0.3).effect, first(0.3).confounded_with) == (whole.effect.name, (loss.effect.name,))
    assert first(0.01).effect == loss.effect.name


def test_what_may_stand_beside_one_of_two_in_the_place_of_the_other_is_a_rival(
    as_before: tuple[Analysis, Record],
) -> None:
    analysis, record = as_before
    contact, offset, drift, _ = analysis.tried
    pairs = ((0.5, contact, offset), (0.4, contact, drift))
    single = tuple((0.0, each) for each in analysis.tried)
    verdict = replace(analysis.verdict, nothing=0.01, unknown=0.0, single=single, pairs=pairs)
    answer = answered(replace(analysis, verdict=verdict), record)
    sure = {each.effect: each.confidence for each in answer.findings}
    assert answer.verdict == "ambiguous"
    assert set(sure) == {contact.effect.name, offset.effect.name, drift.effect.name}
    assert sure[drift.effect.name] == pytest.approx(0.4)


def test_of_two_at_once_nobody_is_sure(as_before: tuple[Analysis, Record]) -> None:
    analysis, record = as_before
    contact, offset, *_ = analysis.tried
    single = tuple((0.0, each) for each in analysis.tried)
    both = replace(analysis.verdict, nothing=0.0, unknown=0.0, single=single, pairs=((0.99, contact, offset),))
    answer = answered(replace(analysis, verdict=both), record)
    assert {each.effect for each in answer.findings} == {contact.effect.name, offset.effect.name}
    assert [each.confidence for each in answer.findings] == [SURE_ELSEWHERE] * 2


def test_of_an_electrode_that_nobody_knows_nobody_is_sure(as_before: tuple[Analysis, Record]) -> None:
    analysis, record = as_before
    contact, *others = analysis.tried
    sure = []
    for causes in ((), ("lithium",)):
        first = replace(contact, effect=replace(contact.effect, causes=causes))
        every = (first, *others)
        single = ((0.99, first), *((0.0, each) for each in others))
        verdict = replace(analysis.verdict, nothing=0.0, unknown=0.0, single=single, pairs=())
        (finding,) = answered(replace(analysis, tried=every, verdict=verdict), record).findings
        sure.append(finding.confidence)
    assert sure[0] > 0.9 and sure[1] == SURE_ELSEWHERE


def test_a_gain_of_the_current_stands_beside_a_capacity_that_explains_as_much(
    as_before: tuple[Analysis, Record],
) -> None:
    analysis, record = as_before
    gain, whole, *_ = analysis.tried
    gain = replace(gain, effect=replace(gain.effect, like=(whole.effect.name,)))
    verdict = replace(analysis.verdict, nothing=0.01, single=((0.9, whole), (1e-4, gain)), pairs=())
    for share, rivals in ((0.95, (gain.effect.name,)), (0.5, ())):
        less = replace(gain, weighed=replace(gain.weighed, log_likelihood=100.0 * share))
        more = replace(whole, weighed=replace(whole.weighed, log_likelihood=100.0))
        single = ((0.9, more), (1e-4, less))
        own = replace(analysis, tried=(less, more), verdict=replace(verdict, single=single))
        assert answered(own, record).findings[0].confounded_with == rivals
