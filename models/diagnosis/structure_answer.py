"""From the analysis of a structure to the answer of the public contract."""

from __future__ import annotations

import time

import numpy as np

from models.diagnosis.candidates import Candidate
from models.diagnosis.confidence import confidence
from models.diagnosis.explanation import explain
from models.diagnosis.findings import Diagnosis, Finding, Verdict
from models.diagnosis.next_experiment import discriminating_request
from models.diagnosis.parameters import parameters
from models.diagnosis.ranking import Ranking
from models.diagnosis.record import Record
from models.diagnosis.reference import Reference
from models.diagnosis.structure import StructureAnalysis, held_out_mse
from models.diagnosis.unknown import depends_on

_SHOWN_RIVALS = 3


def structure_answer(analysis: StructureAnalysis, reference: Reference, record: Record, started: float) -> Diagnosis:
    """Verdict and findings.

    Parameters
    ----------
    analysis : of the record's runs
    reference : model that the next experiment is asked for with
    record : with the network's error, which the findings' figures are about
    started : reading of `time.perf_counter` when the diagnosis began
    """
    ranking = analysis.ranking
    named = ranking.significant and _confirmed(analysis, ranking.candidates[0])
    findings: list[Finding] = []
    if named:
        findings = _findings(analysis, ranking, record)
    rivals = ranking.rivals if named else ()
    request = None
    if rivals:
        voltage_V = np.concatenate([run.voltage_V[run.measured] for run in record.runs])
        last = record.soc[-1] + float(record.runs[-1].charge_Ah[-1]) / reference.capacity_Ah
        request = discriminating_request(reference, (ranking.candidates[0].effect.name, rivals[0]), voltage_V, last)
    # An effect that helps only the runs it was fitted to is none, but the error that it was named for is still there.
    unknown = not named and (ranking.unknown or ranking.significant)
    left = analysis.comparison.evidence
    depends = depends_on(analysis.comparison.runs.views, left.error_V - left.absorbed(left.error_V)) if unknown else ()
    return Diagnosis(
        verdict="unknown_effect"
        if unknown
        else "ambiguous"
        if rivals
        else "missing"
        if findings
        else "nothing_missing",
        mode="structure",
        findings=tuple(findings),
        noise_floor_mV=record.noise_floor_mV,
        unexplained_mV=findings[0].error_after_mV if findings else record.rms_mV,
        depends_on=depends,
        next_experiment=request,
        seconds=time.perf_counter() - started,
        remarks=tuple(_remarks(analysis)),
    )


def _verdict(findings: list[Finding], rivals: tuple[str, ...]) -> Verdict:
    if not findings:
        return "nothing_missing"
    return "ambiguous" if rivals else "missing"


def _confirmed(analysis: StructureAnalysis, candidate: Candidate) -> bool:
    """Whether the diagnosed runs, which the refit has not seen, get better by it."""
    return held_out_mse(analysis, candidate) < held_out_mse(analysis)


def _findings(analysis: StructureAnalysis, ranking: Ranking, record: Record) -> list[Finding]:
    comparison = analysis.comparison
    shown = list(ranking.candidates[: 1 + min(len(ranking.rivals), _SHOWN_RIVALS)])
    names = [each.effect.name for each in shown]
    evidence, n = comparison.evidence, len(comparison.evidence.error_V)
    without = held_out_mse(analysis)
    findings = []
    for number, each in enumerate(shown):
        gained = max(without - held_out_mse(analysis, each), 0.0)
        after_mV = 1e3 * float(np.sqrt(max((1e-3 * record.rms_mV) ** 2 - gained, 0.0)))
        values = parameters(comparison, each)
        share = (evidence.cost - each.solution.cost) / max(evidence.cost - n * comparison.own_mse, 1e-300)
        remaining_mV = 1e3 * float(np.sqrt(each.solution.cost / n))
        others = tuple(name for name in names if name != each.effect.name)
        findings.append(
            Finding(
                each.effect.name,
                number + 1,
                record.rms_mV,
                after_mV,
                confidence(ranking.margin, len(ranking.rivals)),
                values,
                others,
                explain(each.effect, share, remaining_mV, values, others, "structure"),
                {
                    "refitted_before_mV": 1e3 * float(np.sqrt(evidence.cost / n)),
                    "refitted_after_mV": remaining_mV,
                    "explained_share_of_new": share,
                    "margin": ranking.margin,
                },
            )
        )
    return findings


def _remarks(analysis: StructureAnalysis) -> list[str]:
    remarks = []
    if analysis.resolution:
        remarks.append(
            f"the open-circuit curve needs more local models along the SoC: {analysis.resolution} bumps more lower the "
            "held-out error"
        )
    second = analysis.second
    if second is not None and second.significant:
        name = second.candidates[0].effect.title
        remarks.append(f"beside it a further effect is likely: {name.lower()}; add the first and diagnose again")
    if analysis.n_train == 0:
        remarks.append("without training runs effects were judged on held-out blocks of the diagnosed runs")
    return remarks
