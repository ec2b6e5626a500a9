"""Report of a campaign: its stages, what its models are worth, what the diagnosis says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench_service.reports import words
from bench_service.reports.comparison import error_row
from bench_service.reports.diagnosis import diagnosis_summary, left_over
from bench_service.reports.document import Heading, Key, Keys, Part, Points, Report, Section, Table
from bench_service.reports.drawing import BLUE, RUST, Bar, bars
from bench_service.store.records import CampaignRecord

STAGES = {
    "design": "Design of the profiles",
    "run": "Training run",
    "fit": "Fit of the model",
    "rounds": "Further rounds",
    "observe": "Held-out run, observer live",
    "compare": "Comparison",
    "change": "Runs after the change",
    "diagnose": "Diagnosis",
    "report": "Summary",
}
_ROLES = {
    "train": "training",
    "validate": "held out",
    "changed": "after the change",
    "changed_validate": "after the change, held out",
}


def campaign_report(heading: Heading, record: CampaignRecord, called: Mapping[str, str] | None = None) -> Report:
    """Put the report together, as far as the campaign came.

    Parameters
    ----------
    called : what people call a run or a model, by its id
    """
    names, result = called or {}, record.result or {}
    sections = []
    if result.get("validation"):
        sections.append(Section("Errors", _errors(result)))
    if result.get("model_chain"):
        sections.append(Section("Models", _models(result["model_chain"], result.get("sensor_noise_mV"), names)))
    if result.get("diagnosis"):
        sections.append(Section("Diagnosis", [*diagnosis_summary(result["diagnosis"]), left_over(result["diagnosis"])]))
    if result.get("runs"):
        sections.append(Section("Runs", [_runs(result["runs"], names)]))
    sections.append(Section("Stages", [_stages(record)]))
    return Report(heading, _summary(record, result), sections)


def _summary(record: CampaignRecord, result: Mapping[str, Any]) -> list[Part]:
    end = f": {words.told(record.message)}" if record.state != "completed" and record.message else ""
    parts: list[Part] = [words.sentence(f"{words.state(record.state).capitalize()}{end}")]
    keys = []
    if result.get("validation"):
        noise = result.get("sensor_noise_mV")
        against = "" if noise is None else f"noise of the measurement {words.millivolts(noise)}"
        keys.append(Key("RMS error on the held-out run", words.millivolts(result["validation"]["rmse_mV"]), against))
    soc = result.get("soc")
    if soc:
        after = soc["converged_after_s"]
        note = f"below 3 % from {words.duration(after)} on" if after else "below 3 % all the time"
        note = "not below 3 % to the end" if after is None else note
        keys.append(Key("Error of the live state of charge", words.percent(soc["rmse"], 2), note))
    if result.get("samples"):
        missed = f"{words.count(result['missed_ticks'])} missed, in {len(result.get('runs', []))} runs"
        keys.append(Key("Samples", words.count(result["samples"]), missed))
    if result.get("seconds"):
        keys.append(Key("Time taken", words.duration(result["seconds"]), "from design to report"))
    return [*parts, Keys(keys)] if keys else parts


def _errors(result: Mapping[str, Any]) -> list[Part]:
    rows = [error_row("On the held-out run, which no fit saw", result["validation"])]
    if result.get("train"):
        rows.insert(0, error_row("On the training runs", result["train"]))
    heads = ("", "RMS", "Mean size", "95 % are below", "Largest", "Mean, measured − model",
             "RMS over the voltage's range", "Samples")  # fmt: skip
    parts: list[Part] = [Table(heads, rows, frozenset(range(1, 8)))]
    soc = result.get("soc")
    if soc:
        said = [
            f"The observer was started {100.0 * abs(soc['started_off_by']):.0f} points of state of charge off.",
            f"Largest error of its state of charge {words.percent(soc['max_error'], 2)}, at the end "
            f"{words.percent(soc['end_error'], 2)}; {words.percent(soc['coverage_95'], 1)} of the time within its "
            "95 % band.",
        ]
        parts.append(Points(said))
    return parts


def _models(chain: Sequence[Mapping[str, Any]], noise_mV: float | None, names: Mapping[str, str]) -> list[Part]:
    shown, rows = [], []
    for each in chain:
        added = "as fitted" if each["effect"] is None else f"with: {words.effect(each['effect'])}"
        error = each["validation_rmse_mV"]
        shown.append(
            Bar(words.upper_first(added), error, words.millivolts(error), RUST if each["effect"] is None else BLUE)
        )
        sizes = "; ".join(f"{name} {value}" for name, value in words.parameters(each.get("parameters") or {}))
        rows.append((names.get(each["model"], each["model"][:8]), added, sizes, words.millivolts(error)))
    dashed = "" if noise_mV is None else f"; dashed: noise of the measurement, {words.millivolts(noise_mV)}"
    return [
        bars(f"RMS error on runs that the model never saw{dashed}", shown, noise_mV),
        Table(("Model", "What it has", "Found", "RMS error, held out"), rows, frozenset({3})),
    ]


def _runs(runs: Sequence[Mapping[str, Any]], names: Mapping[str, str]) -> Table:
    rows = [
        (
            names.get(each["run_id"], each["run_id"][:8]),
            _ROLES.get(each["role"], words.plain(each["role"])),
            words.count(each["n_samples"]),
            words.count(each["missed_ticks"]),
        )
        for each in runs
    ]
    return Table(("Run", "Used as", "Samples", "Missed"), rows, frozenset({2, 3}))


def _stages(record: CampaignRecord) -> Table:
    rows = [
        (
            STAGES.get(stage["name"], words.plain(stage["name"])),
            words.state(stage["state"]),
            words.duration(stage["seconds"]),
            words.told(stage["detail"]) if stage["detail"] != stage["state"] else "",
        )
        for stage in record.stages
    ]
    return Table(("Stage", "State", "Took", "What came of it"), rows, frozenset({2}))
