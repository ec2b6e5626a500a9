"""Verdict, findings and remarks of a change, from analyses that are put together here."""

import time
from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import GridRun
from models.diagnosis.answer.change_answer import change_answer
from models.diagnosis.answer.findings import Diagnosis
from models.diagnosis.change.change import ChangeAnalysis
from models.diagnosis.evidence.candidates import Comparison, try_effect
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.ranking import Ranking, rank
from models.diagnosis.reference.record import Record
from models.diagnosis.thermal.channel import ThermalComparison, WarmthTrial
from models.effects import effect
from tests.unit.models.diagnosis.hand_reference import SLOPE_V, SOC, compared, reference, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH

CURRENT_A = steps_A(3000, largest_A=4.0)
NOISE_V = 5e-4
NAMES = ("series_resistance", "voltage_offset", "current_offset", "self_discharge")


def analysed(added_V: np.ndarray | float) -> tuple[ChangeAnalysis, Record]:
    """A run with something on top, whose network's error is the reference model's."""
    run = true_run(CURRENT_A, added_V=added_V, noise_V=NOISE_V)
    comparison = compared(run, NAMES, own_mse=NOISE_V**2, noise_mse=NOISE_V**2)
    ranking = rank(comparison, [try_effect(comparison, each) for each in comparison.effects])
    named = (Named(comparison, ranking),) if ranking.significant and ranking.explained else ()
    record = Record([run], [SOC], [comparison.runs.error_V])
    return ChangeAnalysis(reference(), comparison, ranking, named, None, ()), record


def answered(analysis: ChangeAnalysis, record: Record, has_train: bool = True) -> Diagnosis:
    return change_answer(analysis, record, time.perf_counter(), has_train)


def parts(analysis: ChangeAnalysis) -> tuple[Comparison, Ranking]:
    assert analysis.comparison is not None and analysis.ranking is not None
    return analysis.comparison, analysis.ranking


def test_a_named_effect_is_missing_with_its_figures() -> None:
    answer = answered(*analysed(0.004 * CURRENT_A))
    (first,) = answer.findings
    assert (answer.verdict, answer.mode, first.effect, first.rank) == ("missing", "change", "series_resistance", 1)
    before_mV = 1e3 * float(np.sqrt(np.mean((0.004 * CURRENT_A) ** 2) + NOISE_V**2))
    assert first.error_before_mV == pytest.approx(before_mV, rel=0.02)
    assert first.error_after_mV == answer.unexplained_mV == pytest.approx(1e3 * NOISE_V, rel=0.05)
    assert first.evidence["explained_share_of_new"] == pytest.approx(1.0, abs=0.01)
    assert first.evidence["reference_after_mV"] == pytest.approx(1e3 * NOISE_V, rel=0.05)
    assert first.parameters["resistance_Ohm"].value == pytest.approx(0.004, rel=0.01)
    assert answer.next_experiment is None and answer.depends_on == () and first.confounded_with == ()


def test_nothing_new_is_nothing_missing() -> None:
    answer = answered(*analysed(0.0))
    assert (answer.verdict, answer.findings) == ("nothing_missing", ())
    assert answer.unexplained_mV == pytest.approx(1e3 * NOISE_V, rel=0.05)
    assert any("would not have been seen" in remark for remark in answer.remarks)


def test_something_that_no_effect_explains_is_unknown_with_what_it_depends_on() -> None:
    soc = SOC + np.cumsum(CURRENT_A) / 3600.0 / CAPACITY_AH
    bent_V = np.where(soc > np.median(soc), 0.01, -0.01)
    analysis, record = analysed(bent_V - bent_V.mean())
    answer = answered(replace(analysis, named=()), record)
    assert (answer.verdict, answer.findings) == ("unknown_effect", ())
    assert answer.depends_on[0][0] in ("soc", "time_s", "throughput_Ah")
    assert "soc" in dict(answer.depends_on)


def test_runs_outside_the_trained_domain_are_not_nothing_missing() -> None:
    _, record = analysed(0.0)
    answer = answered(ChangeAnalysis(reference(), None, None, (), None, ()), record)
    assert answer.verdict == "unknown_effect"
    assert any("too few samples" in remark for remark in answer.remarks)


def test_rivals_make_it_ambiguous_and_ask_for_an_experiment() -> None:
    run = true_run(CURRENT_A)
    drift_V = -SLOPE_V * 0.04 * run.time_s / 3600.0 / CAPACITY_AH
    analysis, record = analysed(drift_V)
    answer = answered(analysis, record)
    assert answer.verdict == "ambiguous"
    first, second = answer.findings[:2]
    assert {first.effect, second.effect} == {"current_offset", "self_discharge"}
    assert first.confounded_with == (second.effect,) and second.confounded_with == (first.effect,)
    assert [each.rank for each in answer.findings] == list(range(1, len(answer.findings) + 1))
    assert answer.next_experiment is not None
    assert answer.next_experiment["rivals"] == [first.effect, second.effect]
    # It begins where the run has ended.
    assert answer.next_experiment["initial_soc"] == pytest.approx(SOC + run.charge_Ah[-1] / CAPACITY_AH)


def warm(mse_K2: float = 0.05) -> tuple[ThermalComparison, WarmthTrial]:
    trial = WarmthTrial(effect("heat_transfer"), (0.05,), (0.001,), mse_K2)
    other = WarmthTrial(effect("reversible_heat"), (1e-4,), (1e-5,), 0.5)
    return ThermalComparison((), 0.04, 1.0, (trial, other), ()), trial


def test_a_finding_in_the_temperature_has_the_temperatures_figures() -> None:
    analysis, record = analysed(0.0)
    thermal, trial = warm()
    answer = answered(replace(analysis, thermal=thermal, warmth=(trial,)), record)
    (first,) = answer.findings
    assert (answer.verdict, first.effect) == ("missing", "heat_transfer")
    assert first.parameters["heat_transfer_W_per_K"].value == 0.05
    assert first.evidence["error_before_K"] == 1.0
    assert first.evidence["error_after_K"] == pytest.approx(np.sqrt(0.05))
    assert first.evidence["explained_share_of_temperature"] == pytest.approx(0.95)
    # The voltage is as it was.
    assert first.error_before_mV == first.error_after_mV == record.rms_mV


def test_how_sure_it_is_follows_from_the_next_one_of_its_kind() -> None:
    analysis, record = analysed(0.0)
    thermal, trial = warm()
    near = replace(thermal, trials=(trial, replace(thermal.trials[1], mse_K2=0.051)))
    sure, unsure = (
        answered(replace(analysis, thermal=each, warmth=(trial,)), record).findings[0].confidence
        for each in (thermal, near)
    )
    assert sure > 0.9 > 0.6 > unsure


@pytest.mark.parametrize(("ratio", "first"), [(2.9, "heat_transfer"), (3.1, "series_resistance")])
def test_a_large_change_of_the_voltage_comes_first_and_a_small_one_second(ratio: float, first: str) -> None:
    analysis, record = analysed(0.004 * CURRENT_A)
    thermal, trial = warm()
    _, ranking = parts(analysis)
    answer = answered(
        replace(analysis, ranking=replace(ranking, ratio=ratio), thermal=thermal, warmth=(trial,)), record
    )
    assert [each.effect for each in answer.findings][0] == first
    assert [each.rank for each in answer.findings] == [1, 2]


def test_remarks_say_what_was_left_out_and_what_was_missing() -> None:
    analysis, record = analysed(0.0)
    comparison, _ = parts(analysis)
    partly = replace(comparison, runs=replace(comparison.runs, share_inside=0.6))
    remarks = answered(replace(analysis, comparison=partly), record, has_train=False).remarks
    assert any(remark.startswith("40 % of the samples lie outside") for remark in remarks)
    assert any("without the training runs" in remark for remark in remarks)
    assert not any("without the training runs" in remark for remark in answered(analysis, record).remarks)


def test_a_network_far_coarser_than_the_reference_is_told_so() -> None:
    analysis, record = analysed(0.0)
    coarse = replace(record, error_V=[np.full(len(CURRENT_A), 0.01)])
    assert any("most of it is the network's own" in remark for remark in answered(analysis, coarse).remarks)
    assert not any("the network's own;" in remark for remark in answered(analysis, record).remarks)


def test_runs_far_off_what_the_training_runs_left_are_unknown_although_nothing_is_significant() -> None:
    analysis, record = analysed(0.0)
    comparison, ranking = parts(analysis)
    evidence = replace(comparison.evidence, error_V=np.full(len(CURRENT_A), 0.004))
    far = replace(analysis, comparison=replace(comparison, evidence=evidence), ranking=replace(ranking))
    assert not ranking.unknown
    answer = answered(far, record)
    assert answer.verdict == "unknown_effect"
    assert any("off by 4.0 mV" in remark for remark in answer.remarks)
    # 3 mV beyond its own half a millivolt is asked for.
    near = replace(comparison.evidence, error_V=np.full(len(CURRENT_A), 0.003))
    assert answered(replace(far, comparison=replace(comparison, evidence=near)), record).verdict == "nothing_missing"


def test_voltages_that_were_not_measured_do_not_limit_the_next_experiment() -> None:
    run = true_run(CURRENT_A)
    drift_V = -SLOPE_V * 0.04 * run.time_s / 3600.0 / CAPACITY_AH
    analysis, record = analysed(drift_V)
    holed: GridRun = record.runs[0]
    measured = np.arange(len(holed)) % 2 == 0
    holed = replace(holed, voltage_V=np.where(measured, holed.voltage_V, np.nan), measured=measured)
    request = answered(analysis, replace(record, runs=[holed])).next_experiment
    assert request is not None and np.isfinite(request["limits"]["voltage_V"]).all()
