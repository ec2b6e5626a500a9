"""Verdict, findings and remarks of a structure, from analyses that are put together here."""

import time
from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.answer.findings import Diagnosis
from models.diagnosis.answer.refits import Refit, Refits
from models.diagnosis.answer.structure_answer import structure_answer, unexplained
from models.diagnosis.evidence.candidates import try_effect
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.parameters import Value
from models.diagnosis.evidence.ranking import rank
from models.diagnosis.reference.record import Record
from models.diagnosis.structure.structure import StructureAnalysis
from models.effects import effect
from tests.unit.models.diagnosis.hand_reference import SOC, compared, reference, steps_A, true_run

CURRENT_A = steps_A(3000, largest_A=4.0)
NOISE_V, N_TRAIN = 5e-4, 1500


def analysed(added_V: np.ndarray | float, *names: str) -> tuple[StructureAnalysis, Record]:
    run = true_run(CURRENT_A, added_V=added_V, noise_V=NOISE_V)
    names = names or ("soc_dependence", "charge_transfer")
    comparison = compared(run, names, own_mse=NOISE_V**2, noise_mse=NOISE_V**2)
    ranking = rank(comparison, [try_effect(comparison, each) for each in comparison.effects])
    named = (Named(comparison, ranking),) if ranking.significant and ranking.explained else ()
    record = Record([run], [SOC], [comparison.runs.error_V])
    return StructureAnalysis(comparison, ranking, named, N_TRAIN, 0), record


def answered(analysis: StructureAnalysis, record: Record, refits: Refits | None = None) -> Diagnosis:
    return structure_answer(analysis, reference(), record, time.perf_counter(), refits)


def transfer_V(amplitude_V: float = 0.02) -> np.ndarray:
    return amplitude_V * np.arcsinh(CURRENT_A / (2.0 * 0.7))


def test_a_named_effect_is_missing_and_leaves_what_a_refit_would() -> None:
    analysis, record = analysed(transfer_V(), "charge_transfer")
    answer = answered(analysis, record)
    (first,) = answer.findings
    assert (answer.verdict, answer.mode, first.effect) == ("missing", "structure", "charge_transfer")
    # Held out after the first half: the noise.
    assert first.error_after_mV == answer.unexplained_mV == pytest.approx(1e3 * NOISE_V, rel=0.1)
    assert first.explanation.startswith("Charge transfer")
    assert "is missing in the model" in first.explanation
    assert first.parameters["amplitude_V"].value == pytest.approx(0.02, rel=0.05)
    assert first.evidence["refitted_after_mV"] == pytest.approx(1e3 * NOISE_V, rel=0.1)
    # What the same samples say without it, and that a refit alone does not do it.
    second_half = analysis.comparison.evidence.error_V[N_TRAIN:]
    before_mV = 1e3 * float(np.sqrt(np.mean(second_half**2)))
    assert first.evidence["forecast_samples_before_mV"] == pytest.approx(before_mV)
    assert first.error_after_mV < 0.5 * first.evidence["forecast_without_mV"] <= before_mV


def test_without_training_runs_nothing_is_forecast() -> None:
    analysis, record = analysed(transfer_V(), "charge_transfer")
    (first,) = answered(replace(analysis, n_train=0), record).findings
    assert not [name for name in first.evidence if name.startswith("forecast")]


def test_nothing_is_missing_where_only_noise_is_left() -> None:
    analysis, record = analysed(0.0)
    assert not unexplained(analysis)
    answer = answered(analysis, record)
    assert (answer.verdict, answer.findings, answer.depends_on) == ("nothing_missing", (), ())
    assert answer.unexplained_mV == record.rms_mV


def test_an_error_far_above_the_noise_that_nothing_explains_is_unknown() -> None:
    analysis, record = analysed(0.01 * np.sign(np.sin(np.arange(3000) / 9.0)), "entropic_voltage", "hysteresis")
    open_ = replace(analysis, named=())
    assert unexplained(open_)
    assert answered(open_, record).verdict == "unknown_effect"


def with_left(analysis: StructureAnalysis, rms_V: float) -> StructureAnalysis:
    evidence = replace(analysis.comparison.evidence, error_V=np.full(len(CURRENT_A), rms_V))
    ranking = replace(analysis.ranking, something_new=False)
    return replace(analysis, comparison=replace(analysis.comparison, evidence=evidence), ranking=ranking, named=())


def test_two_and_a_half_times_the_noise_may_be_left() -> None:
    analysis, _ = analysed(0.0)
    assert not unexplained(with_left(analysis, 2.4 * NOISE_V))
    assert unexplained(with_left(analysis, 2.6 * NOISE_V))
    # Where the noise cannot be told, nothing is far above it.
    quiet = with_left(analysis, 2.6 * NOISE_V)
    assert not unexplained(replace(quiet, comparison=replace(quiet.comparison, noise_mse=0.0)))


def test_rivals_that_explain_too_little_leave_it_unexplained() -> None:
    analysis, _ = analysed(transfer_V(), "charge_transfer")
    assert not unexplained(analysis)
    named = analysis.named[0]
    first = named.ranking.candidates[0]
    poor = replace(first, solution=replace(first.solution, cost=3000 * (3.0 * NOISE_V) ** 2))
    ranking = replace(named.ranking, candidates=(poor,), rivals=("hysteresis",))
    assert unexplained(replace(analysis, named=(replace(named, ranking=ranking),)))
    alone = replace(ranking, rivals=())
    assert not unexplained(replace(analysis, named=(replace(named, ranking=alone),)))


def with_rival(name: str) -> tuple[StructureAnalysis, Record]:
    analysis, record = analysed(transfer_V(), "charge_transfer", name)
    (named,) = analysis.named
    ranking = replace(named.ranking, rivals=(name,))
    return replace(analysis, named=(replace(named, ranking=ranking),)), record


def test_a_rival_is_told_where_the_error_falls_with_it() -> None:
    answer = answered(*with_rival("soc_dependence"))
    assert answer.verdict == "ambiguous"
    first, second = answer.findings
    assert (first.effect, second.effect) == ("charge_transfer", "soc_dependence")
    assert first.error_after_mV < second.error_after_mV < second.error_before_mV
    assert (first.confidence, second.confidence) == (0.6, pytest.approx(0.4))


def test_a_rival_with_which_it_rises_is_none() -> None:
    # What it learns of the first half does harm in the second.
    answer = answered(*with_rival("hysteresis"))
    assert (answer.verdict, [each.effect for each in answer.findings]) == ("missing", ["charge_transfer"])
    assert answer.findings[0].confounded_with == () and answer.next_experiment is None


def refits(*names: str) -> Refits:
    values = {"time_constant_s": Value(900.0, None, "s")}
    return Refits(tuple(Refit(effect(name), values, 2.0 + k, 3.0 + k) for k, name in enumerate(names)), 8.0)


def test_what_refits_name_goes_before_sensitivities() -> None:
    analysis, record = analysed(transfer_V(), "charge_transfer")
    answer = answered(analysis, record, refits("relaxation"))
    (first,) = answer.findings
    assert (answer.verdict, first.effect, first.confidence) == ("missing", "relaxation", 0.8)
    assert (first.error_before_mV, first.error_after_mV) == (record.rms_mV, 3.0)
    assert first.evidence == {"held_out_before_mV": 8.0, "held_out_after_mV": 2.0}
    assert "from 8.0 to 2.0 mV" in first.explanation
    assert any("found by refits" in remark for remark in answer.remarks)


def test_refits_that_come_near_each_other_are_rivals() -> None:
    analysis, record = analysed(0.0)
    answer = answered(analysis, record, refits("relaxation", "hysteresis"))
    assert answer.verdict == "ambiguous"
    assert [(each.effect, each.rank, each.confidence) for each in answer.findings] == [
        ("relaxation", 1, 0.6),
        ("hysteresis", 2, 0.4),
    ]
    three = answered(analysis, record, refits("relaxation", "hysteresis", "soc_dependence"))
    assert [each.confidence for each in three.findings] == pytest.approx([0.6, 0.2, 0.2])
    assert answer.findings[0].confounded_with == ("hysteresis",)
    # What is unexplained is what the named one leaves, not its rival.
    assert answer.unexplained_mV == 3.0
    assert answer.next_experiment is not None and answer.next_experiment["rivals"] == ["relaxation", "hysteresis"]


def test_remarks_on_the_curve_on_pairs_and_on_missing_training_runs() -> None:
    analysis, record = analysed(0.0)
    assert answered(analysis, record).remarks == ()
    assert "20 more of them" in answered(replace(analysis, resolution=20), record).remarks[0]
    assert "held-out blocks" in answered(replace(analysis, n_train=0), record).remarks[0]
    found, record = analysed(transfer_V(), "charge_transfer")
    pair = replace(found, named=(*found.named, *found.named))
    assert any("add one after the other" in remark for remark in answered(pair, record).remarks)
