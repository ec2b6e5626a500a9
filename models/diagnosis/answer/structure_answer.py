"""From the analysis of a structure to the answer of the public contract."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from models.diagnosis.answer.confidence import confidence, of_rivals
from models.diagnosis.answer.explanation import explain
from models.diagnosis.answer.findings import Diagnosis, Finding
from models.diagnosis.answer.next_experiment import discriminating_request
from models.diagnosis.answer.refits import Refits, refit_findings
from models.diagnosis.answer.unknown import depends_on
from models.diagnosis.evidence.candidates import Candidate
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.parameters import Value
from models.diagnosis.evidence.reading import Readings
from models.diagnosis.reference.record import Record
from models.diagnosis.reference.reference import Reference
from models.diagnosis.structure.structure import StructureAnalysis, held_out_mse

_SHOWN_RIVALS = 3
# What a refit may leave, in units of the noise, where nothing is said to be missing; and what any may, in V: a quiet
# sensor makes no model worse.
_MUCH_LEFT, _LITTLE_V = 2.5, 1e-3
# Share of the samples from which on it is worth a word that they were left out.
_LEAST_LEFT_OUT = 0.005


def unexplained(analysis: StructureAnalysis) -> bool:
    """Whether sensitivities name nothing although something is missing, or rivals that explain too little."""
    ranking = analysis.ranking
    if analysis.named:
        first = analysis.named[0].ranking
        return bool(first.rivals) and _much_left(analysis, first.candidates[0].solution.cost)
    return ranking.unknown or ranking.significant or _much_left(analysis, analysis.comparison.evidence.cost)


def structure_answer(
    analysis: StructureAnalysis,
    reference: Reference,
    record: Record,
    started: float,
    refits: Refits | None = None,
    left_out: float = 0.0,
) -> Diagnosis:
    """Verdict and findings.

    Parameters
    ----------
    analysis : of the record's runs
    reference : model that the next experiment is asked for with
    record : the voltages that can show an effect, with the network's error, which the findings' figures are about
    started : reading of `time.perf_counter` when the diagnosis began
    refits : what refits ask for; None: they were not needed, or name nothing
    left_out : share of the runs' voltages that the record leaves out
    """
    if refits is not None:
        findings, n_named = refit_findings(refits, record), 1
        rivals = findings[0].confounded_with
    else:
        findings, n_named = _findings(analysis, record), len(analysis.named)
        rivals = findings[0].confounded_with if findings else ()
    request = None
    if rivals:
        voltage_V = np.concatenate([run.voltage_V[run.measured] for run in record.runs])
        last = record.soc[-1] + float(record.runs[-1].charge_Ah[-1]) / reference.capacity_Ah
        request = discriminating_request(reference, (findings[0].effect, rivals[0]), voltage_V, last)
    open_ = unexplained(analysis)
    left = analysis.comparison.evidence
    depends = depends_on(analysis.comparison.runs.views, left.error_V - left.absorbed(left.error_V)) if open_ else ()
    verdict = "missing" if findings else "unknown_effect" if open_ else "nothing_missing"
    return Diagnosis(
        verdict="ambiguous" if rivals else verdict,
        mode="structure",
        findings=tuple(findings),
        noise_floor_mV=record.noise_floor_mV,
        unexplained_mV=findings[n_named - 1].error_after_mV if findings else record.rms_mV,
        depends_on=depends,
        next_experiment=request,
        seconds=time.perf_counter() - started,
        remarks=(*_remarks(analysis, refits), *_steep(left_out)),
    )


def _steep(left_out: float) -> list[str]:
    if left_out < _LEAST_LEFT_OUT:
        return []
    return [
        f"{100 * left_out:.0f} % of the samples, where half a point of the state of charge makes more than 20 mV, were "
        "left out; the errors are those of the others: near empty and full the counted charge decides, not an effect"
    ]


def _much_left(analysis: StructureAnalysis, cost_V2: float) -> bool:
    """Whether an error far above the noise remains: then it is not so that nothing is missing."""
    comparison = analysis.comparison
    allowed_V2 = max(_MUCH_LEFT**2 * comparison.noise_mse, _LITTLE_V**2)
    return comparison.noise_mse > 0.0 and allowed_V2 < cost_V2 / len(comparison.evidence.error_V)


def _findings(analysis: StructureAnalysis, record: Record) -> list[Finding]:
    """The named effects, each with what it leaves beside those before it; then the rivals that lower the error, too."""
    findings: list[Finding] = []
    rivals: list[Finding] = []
    readings, before_V2 = Readings(analysis.named), analysis.as_it_is_mse
    for number, named in enumerate(analysis.named):
        shown = named.ranking.candidates[: 1 + min(len(named.ranking.rivals), _SHOWN_RIVALS)]
        left = [held_out_mse(named.comparison, analysis.n_train, each) for each in shown]
        if number + 1 < len(analysis.named):
            # The next one's comparison has this one in the model already; its own has the next.
            left[0] = held_out_mse(analysis.named[number + 1].comparison, analysis.n_train)
        lower = [k for k, mse in enumerate(left) if k == 0 or mse < before_V2]
        names = [shown[k].effect.name for k in lower]
        errors_mV = [(record.rms_mV, 1e3 * float(np.sqrt(left[k]))) for k in lower]
        read = [readings.parameters(named, shown[k]) for k in lower]
        tried = [
            _finding(named, shown[k], names, error_mV, values, findings)
            for k, error_mV, values in zip(lower, errors_mV, read, strict=True)
        ]
        figures = _forecast_figures(analysis, named)
        tried = [replace(each, evidence=each.evidence | figures) for each in tried]
        chance = of_rivals(tried[0].confidence, len(tried) - 1)
        rivals += [replace(each, confidence=chance) for each in tried[1:]]
        findings.append(tried[0])
        before_V2 = left[0]
    told = {each.effect for each in findings}
    every = findings + [each for each in rivals if each.effect not in told]
    return [replace(each, rank=number + 1) for number, each in enumerate(every)]


def _forecast_figures(analysis: StructureAnalysis, named: Named) -> dict[str, float]:
    """What the samples of a forecast say without the effect: the network as it is, and refitted likewise.

    The forecast is of the diagnosed samples within the trained SoC, with the training runs' parameters, an open-circuit
    curve as fine as these ask for and each run's start of its own. Without training runs there is none.
    """
    n = analysis.n_train
    error_V = analysis.comparison.evidence.error_V[n:]
    if n == 0 or not len(error_V):
        return {}
    return {
        "forecast_samples_before_mV": 1e3 * float(np.sqrt(np.mean(error_V**2))),
        "forecast_without_mV": 1e3 * float(np.sqrt(held_out_mse(named.comparison, n))),
    }


def _finding(
    named: Named,
    candidate: Candidate,
    names: list[str],
    error_mV: tuple[float, float],
    values: dict[str, Value],
    beside: list[Finding],
) -> Finding:
    comparison, ranking = named.comparison, named.ranking
    evidence, n = comparison.evidence, len(comparison.evidence.error_V)
    share = (evidence.cost - candidate.solution.cost) / max(evidence.cost - n * comparison.own_mse, 1e-300)
    remaining_mV = 1e3 * float(np.sqrt(candidate.solution.cost / n))
    others = tuple(name for name in names if name != candidate.effect.name)
    given = [each.effect for each in beside]
    return Finding(
        candidate.effect.name,
        1,
        *error_mV,
        confidence(ranking),
        values,
        others,
        explain(candidate.effect, share, remaining_mV, values, others, "structure", given),
        {
            "beside": given,
            "refitted_before_mV": 1e3 * float(np.sqrt(evidence.cost / n)),
            "refitted_after_mV": remaining_mV,
            "explained_share_of_new": share,
        }
        | ranking.figures,
    )


def _remarks(analysis: StructureAnalysis, refits: Refits | None) -> list[str]:
    remarks = []
    if refits is not None:
        remarks.append(
            "to first order no effect explains the error; what is named was found by refits, judged on held-out "
            "training runs; diagnose again once it is added: more may be missing"
        )
    if analysis.resolution:
        remarks.append(
            f"the open-circuit curve needs more local models along the SoC: {analysis.resolution} more of them lower "
            "the held-out error"
        )
    if len(analysis.named) > 1 and refits is None:
        remarks.append("two effects are missing together; add one after the other")
    if analysis.n_train == 0:
        remarks.append("without training runs effects were judged on held-out blocks of the diagnosed runs")
    return remarks
