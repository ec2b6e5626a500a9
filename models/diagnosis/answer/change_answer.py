"""From the evidence of a change to the answer of the public contract."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.answer.confidence import SURE_ELSEWHERE, most_sure
from models.diagnosis.answer.explanation import explain, explain_no_heat, explain_power
from models.diagnosis.answer.findings import Diagnosis, Finding, Shown
from models.diagnosis.answer.next_experiment import discriminating_request
from models.diagnosis.answer.unknown import depends_on
from models.diagnosis.likelihood.analysis import Analysis
from models.diagnosis.likelihood.shapes import whole_V
from models.diagnosis.likelihood.tried import Tried
from models.diagnosis.likelihood.values import values_of
from models.diagnosis.reference.record import Record
from models.effects.view import View

_SHOWN_RIVALS = 3
# A network that much coarser than what is known of the cell is told so.
_COARSE = 2.0
# No noise is smaller than this, in V, and no share of what is white.
_LEAST_NOISE_V, _LEAST_SHARE = 1e-9, 1e-3


def change_answer(
    analysis: Analysis, record: Record, started: float, has_train: bool, *, with_power: bool = True
) -> Diagnosis:
    """Verdict and findings.

    Parameters
    ----------
    analysis : of the record's runs
    record : with the network's error, which the findings' figures are about
    started : reading of `time.perf_counter` when the diagnosis began
    has_train : whether the training runs were at hand
    with_power : say what would have been seen, and what could hide best
    """
    verdict, named, rivals = analysis.verdict, analysis.named, analysis.rivals[:_SHOWN_RIVALS]
    findings, left = _findings(analysis, rivals, record)
    unknown = verdict.something and not named
    cell = analysis.sight.known.cell
    request = None
    if rivals:
        voltage_V = np.concatenate([run.voltage_V[run.measured] for run in record.runs])
        last = record.soc[-1] + float(record.runs[-1].charge_Ah[-1]) / cell.capacity_Ah
        request = discriminating_request(cell, (named[0].effect.name, rivals[0].effect.name), voltage_V, last)
    views = tuple(run.points for run in analysis.sight.runs)
    depends = depends_on(views, analysis.back.error[: analysis.sight.n_voltage]) if unknown else ()
    shown = analysis.power if with_power else []
    power = tuple(
        Shown(
            each.effect.name,
            each.size if np.isfinite(each.size) else None,
            each.unit,
            1e3 * each.rms_V if np.isfinite(each.rms_V) else None,
            each.rms_K if each.rms_K is not None and np.isfinite(each.rms_K) else None,
        )
        for each in shown
    )
    hides = () if verdict.something or not with_power else analysis.hides_best
    return Diagnosis(
        verdict="unknown_effect" if unknown else "ambiguous" if rivals else "missing" if named else "nothing_missing",
        mode="change",
        findings=tuple(findings),
        noise_floor_mV=record.noise_floor_mV,
        unexplained_mV=left.rms_mV,
        depends_on=depends,
        next_experiment=request,
        seconds=time.perf_counter() - started,
        remarks=tuple(_remarks(analysis, record, has_train, with_power)),
        power=power,
        hides_best=hides,
    )


def _findings(analysis: Analysis, rivals: tuple[Tried, ...], record: Record) -> tuple[list[Finding], Record]:
    """The named effects, each with what it leaves of the network's error beside those before it; then the rivals."""
    findings: list[Finding] = []
    left = record
    most = _most(analysis, record)
    confidence = min(analysis.confidence, most)
    for each in analysis.named:
        given = [finding.effect for finding in findings]
        others = tuple(other.effect.name for other in rivals)
        after = left.less(_parts_V(analysis, each, record))
        sure = min(confidence, analysis.chance(each)) if given else confidence
        findings.append(_finding(analysis, each, (record, after), sure, others, given))
        left = after
    names = tuple(finding.effect for finding in findings)
    pairs = len(analysis.named) > 1
    chance = {each.effect.name: analysis.chance(each) if pairs else p for p, each in analysis.verdict.single}
    chance |= analysis.untold_chances
    for each in rivals:
        after = record.less(_parts_V(analysis, each, record))
        others = (*names, *(other.effect.name for other in rivals if other is not each))
        # What is told in the place of a likelier cause stands for that as well.
        sure = min(chance[each.effect.name], confidence)
        findings.append(_finding(analysis, each, (record, after), sure, others, []))
    return [replace(finding, rank=number + 1) for number, finding in enumerate(findings)], left


def _most(analysis: Analysis, record: Record) -> float:
    """How sure anything may be said of this cell.

    Where unseen training runs are off by more than the noise, the cell is not quite what the equations say; of what was
    named with more than 0.9 there, 21 of 26 were right (`benchmarks/diagnosis_foreign.py`), on cells of the models'
    class, whose factor is mostly below 1.3, all of 25. The noise is told twice: by neighbouring samples of the judged
    runs, where quick changes and coarse steps pass for it, and by what hangs together with nothing in unseen ones.

    Two at once can stand for a third. Of such two named with more than 0.9 the first was right in 18 of 21 (the same
    benchmark and `diagnosis_change.py`), all three wrong ones where a single effect was there. What an electrode has
    lost whose curve nobody knows is told by what is usual of such curves.
    """
    elsewhere = analysis.sight.known.elsewhere
    off_V2 = float(np.mean(elsewhere.unseen_V**2)) + elsewhere.own_V2
    noise_V = 1e-3 * (record.noise_floor_mV or 0.0)
    by_samples = np.sqrt(off_V2) / max(noise_V, _LEAST_NOISE_V)
    most = most_sure(max(float(by_samples), 1.0 / np.sqrt(max(elsewhere.white_share, _LEAST_SHARE))))
    guessed = any(each.effect.causes for each in analysis.named) and not analysis.electrodes_known
    return min(most, SURE_ELSEWHERE) if guessed or len(analysis.named) > 1 else most


def _finding(
    analysis: Analysis,
    tried: Tried,
    records: tuple[Record, Record],
    confidence: float,
    rivals: tuple[str, ...],
    given: list[str],
) -> Finding:
    before, after = records
    values = values_of(analysis, tried)
    n = analysis.sight.n_voltage
    error_V = analysis.back.error[:n]
    remaining_V = error_V - tried.contribution[:n]
    share = 1.0 - float(np.mean(remaining_V**2) / max(np.mean(error_V**2), 1e-300))
    remaining_mV = 1e3 * float(np.sqrt(np.mean(remaining_V**2)))
    figures = {
        "beside": given,
        "log_likelihood_over_nothing": analysis.sizes[tried.effect.name].log_likelihood,
        "probability_of_nothing": analysis.verdict.nothing,
        "reference_before_mV": 1e3 * float(np.sqrt(np.mean(error_V**2))),
        "reference_after_mV": remaining_mV,
    }
    if len(analysis.back.error) > n:
        left_K = analysis.back.error[n:] - tried.contribution[n:]
        figures["error_before_K"] = float(np.sqrt(np.mean(analysis.back.error[n:] ** 2)))
        figures["error_after_K"] = float(np.sqrt(np.mean(left_K**2)))
    words = explain(tried.effect, share, remaining_mV, values, rivals, "change", given)
    return Finding(tried.effect.name, 1, before.rms_mV, after.rms_mV, confidence, values, rivals, words, figures)


def _parts_V(analysis: Analysis, tried: Tried, record: Record) -> list[FloatArray]:
    """(n,) of each run, the voltage that an effect stands for."""
    sizes, cell = analysis.sizes[tried.effect.name].mean, analysis.sight.known.cell
    return [
        whole_V(tried.effect, tried.shape, sizes, View(cell, run, soc, np.arange(len(run))))
        for run, soc in zip(record.runs, record.soc, strict=True)
    ]


def _remarks(analysis: Analysis, record: Record, has_train: bool, with_power: bool) -> list[str]:
    remarks = []
    inside = analysis.sight.share_inside
    if inside < 1.0:
        remarks.append(f"{100 * (1 - inside):.0f} % of the samples lie outside the trained state of charge")
    if not any(run.warm is not None for run in analysis.sight.runs):
        remarks.append(explain_no_heat(analysis.sight.known.balance is not None))
    rms_mV = 1e3 * float(np.sqrt(np.mean(analysis.back.error[: analysis.sight.n_voltage] ** 2)))
    if not analysis.named and record.rms_mV > _COARSE * rms_mV:
        remarks.append(
            f"the network's error is {record.rms_mV:.1f} mV, that of a finer model of the training runs "
            f"{rms_mV:.1f} mV: most of it is the network's own; ask what its structure lacks"
        )
    if with_power and not analysis.verdict.something:
        every = [(each.effect, each.size) for each in analysis.power]
        hidden = [(one, size) for one, size in every if one.name in analysis.hides_best]
        remarks.append(explain_power(hidden))
    if not has_train:
        remarks.append("without the training runs a change is held against the network's own voltage, errors included")
    return remarks
