"""From the analysis of a change to the answer of the public contract."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.answer.confidence import confidence, warmth_confidence
from models.diagnosis.answer.explanation import explain, explain_warmth
from models.diagnosis.answer.findings import Diagnosis, Finding
from models.diagnosis.answer.next_experiment import discriminating_request
from models.diagnosis.answer.unknown import depends_on
from models.diagnosis.change.change import ChangeAnalysis, contribution_V
from models.diagnosis.evidence.candidates import Candidate
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.parameters import Value, parameters
from models.diagnosis.reference.record import Record
from models.diagnosis.thermal.channel import WarmthTrial

_SHOWN_RIVALS = 3
_LARGE_RATIO = 3.0
# Error of the reference model, over its own and beyond it, with which "nothing is missing" is not an answer.
_MUCH_LEFT, _MUCH_LEFT_V = 3.0, 3e-3
# A network that much coarser than the reference model is told so.
_COARSE = 2.0


def change_answer(analysis: ChangeAnalysis, record: Record, started: float, has_train: bool) -> Diagnosis:
    """Verdict and findings.

    Parameters
    ----------
    analysis : of the record's runs
    record : with the network's error, which the findings' figures are about
    started : reading of `time.perf_counter` when the diagnosis began
    has_train : whether the training runs were at hand
    """
    ranking = analysis.ranking
    warm = [_warmth_finding(analysis, each, record) for each in analysis.warmth]
    electric, left = _voltage_findings(analysis, record)
    # A large change of the voltage is the first thing to say; a small one may be the temperature's doing.
    first = electric + warm if ranking is not None and ranking.ratio >= _LARGE_RATIO else warm + electric
    findings = [replace(each, rank=number + 1) for number, each in enumerate(first)]
    rivals = analysis.named[0].ranking.rivals if analysis.named and first[0] is electric[0] else ()
    # Runs that lie wholly outside the trained domain are not "nothing missing": nothing is known of them.
    unknown = (ranking is None or ranking.unknown or _much_left(analysis)) and not findings
    request = None
    if rivals:
        pair = (analysis.named[0].effect_name, rivals[0])
        voltage_V = np.concatenate([run.voltage_V[run.measured] for run in record.runs])
        last = record.soc[-1] + float(record.runs[-1].charge_Ah[-1]) / analysis.reference.capacity_Ah
        request = discriminating_request(analysis.reference, pair, voltage_V, last)
    verdict = "unknown_effect" if unknown else "nothing_missing" if not findings else "missing"
    depends: tuple[tuple[str, float], ...] = ()
    if unknown and analysis.comparison is not None:
        evidence = analysis.comparison.evidence
        depends = depends_on(analysis.comparison.runs.views, evidence.error_V - evidence.absorbed(evidence.error_V))
    return Diagnosis(
        verdict="ambiguous" if rivals else verdict,
        mode="change",
        findings=tuple(findings),
        noise_floor_mV=record.noise_floor_mV,
        unexplained_mV=left.rms_mV,
        depends_on=depends,
        next_experiment=request,
        seconds=time.perf_counter() - started,
        remarks=tuple(_remarks(analysis, record, has_train)),
    )


def _much_left(analysis: ChangeAnalysis) -> bool:
    """Whether the runs are far off what the training runs say, however well that could be parameters left open."""
    comparison = analysis.comparison
    if comparison is None:
        return False
    rms_V, own_V = _rms_V(comparison.evidence.error_V), float(np.sqrt(comparison.own_mse))
    return rms_V > max(_MUCH_LEFT * own_V, own_V + _MUCH_LEFT_V)


def _rms_V(error_V: FloatArray) -> float:
    return float(np.sqrt(np.mean(error_V**2)))


def _voltage_findings(analysis: ChangeAnalysis, record: Record) -> tuple[list[Finding], Record]:
    """The named effects, each with what it leaves of the network's error beside those before it; then the rivals."""
    findings: list[Finding] = []
    rivals: list[Finding] = []
    left = record
    for named in analysis.named:
        shown = named.ranking.candidates[: 1 + min(len(named.ranking.rivals), _SHOWN_RIVALS)]
        names = [candidate.effect.name for candidate in shown]
        given = [finding.effect for finding in findings]
        tried = [_finding(analysis, named, each, names, (record, left), given) for each in shown]
        findings.append(tried[0][0])
        rivals += [finding for finding, _ in tried[1:]]
        left = tried[0][1]
    told = {each.effect for each in findings}
    return findings + [each for each in rivals if each.effect not in told], left


def _finding(
    analysis: ChangeAnalysis,
    named: Named,
    candidate: Candidate,
    names: list[str],
    records: tuple[Record, Record],
    given: list[str],
) -> tuple[Finding, Record]:
    """One effect, named or rival, and what it leaves of the error beside those before it.

    The record comes twice: as it was measured, and less what those before have explained.
    """
    record, left = records
    comparison, ranking = named.comparison, named.ranking
    parts = [
        contribution_V(analysis.reference, candidate, run, soc)
        for run, soc in zip(record.runs, record.soc, strict=True)
    ]
    after = left.less(parts)
    values = parameters(comparison, candidate)
    cost, n = comparison.evidence.cost, len(comparison.evidence.error_V)
    gained = cost - candidate.solution.cost
    share = gained / max(cost - n * comparison.own_mse, gained, 1e-300)
    remaining_mV = 1e3 * float(np.sqrt(candidate.solution.cost / n))
    others = tuple(name for name in names if name != candidate.effect.name)
    finding = Finding(
        candidate.effect.name,
        1,
        record.rms_mV,
        after.rms_mV,
        confidence(ranking),
        values,
        others,
        explain(candidate.effect, share, remaining_mV, values, others, "change", given),
        {
            "beside": given,
            "reference_before_mV": 1e3 * float(np.sqrt(cost / n)),
            "reference_after_mV": remaining_mV,
            "reference_own_mV": 1e3 * ranking.own_V,
            "explained_share_of_new": share,
        }
        | ranking.figures,
    )
    return finding, after


def _warmth_finding(analysis: ChangeAnalysis, trial: WarmthTrial, record: Record) -> Finding:
    thermal = analysis.thermal
    assert thermal is not None
    values = {
        each.name: Value(value, std, each.unit)
        for each, value, std in zip(trial.effect.parameters, trial.values, trial.std, strict=True)
    }
    before_K, after_K = float(np.sqrt(thermal.mse_K2)), float(np.sqrt(trial.mse_K2))
    # What was named is the best of its kind; the next one of that kind says how sure it is.
    alone = any(each is trial for each in thermal.trials)
    tried = thermal.trials if alone else [pair[0] for pair in thermal.pairs]
    margin = (tried[1].mse_K2 - trial.mse_K2) / trial.mse_K2 if len(tried) > 1 else 10.0
    share = thermal.share(trial)
    return Finding(
        trial.effect.name,
        1,
        record.rms_mV,
        record.rms_mV,
        warmth_confidence(margin),
        values,
        (),
        explain_warmth(trial.effect, share, before_K, after_K, values),
        {"error_before_K": before_K, "error_after_K": after_K, "explained_share_of_temperature": share},
    )


def _remarks(analysis: ChangeAnalysis, record: Record, has_train: bool) -> list[str]:
    remarks = []
    if analysis.comparison is None:
        remarks.append(
            "too few samples lie inside the trained domain to judge the voltage; fit the model on runs that cover it"
        )
    else:
        inside = analysis.comparison.runs.share_inside
        if inside < 1.0:
            remarks.append(
                f"{100 * (1 - inside):.0f} % of the samples lie outside the trained domain and were left out"
            )
        rms_mV = 1e3 * _rms_V(analysis.comparison.evidence.error_V)
        if not analysis.named and record.rms_mV > _COARSE * rms_mV:
            remarks.append(
                f"the network's error is {record.rms_mV:.1f} mV, that of a finer model of the training runs "
                f"{rms_mV:.1f} mV: most of it is the network's own; ask what its structure lacks"
            )
        if not analysis.named and _much_left(analysis):
            remarks.append(
                f"the runs are off by {rms_mV:.1f} mV where the training runs leave "
                f"{1e3 * float(np.sqrt(analysis.comparison.own_mse)):.1f} mV, and no effect can be told from what the "
                "training runs leave open"
            )
    if analysis.ranking is not None:
        least_mV = 1e3 * analysis.ranking.least_V
        remarks.append(f"a change of less than about {least_mV:.1f} mV would not have been seen")
    if not has_train:
        remarks.append("without the training runs a change is held against the network's own voltage, errors included")
    return remarks
