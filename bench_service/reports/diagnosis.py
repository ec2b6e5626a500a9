"""Report of a diagnosis: verdict, evidence for each finding, and where the model is off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bench_service.reports import words
from bench_service.reports.comparison import usability_parts
from bench_service.reports.document import Figure, Heading, Key, Keys, Part, Points, Report, Section, Table
from bench_service.reports.drawing import BLUE, RUST, Bar, bars
from bench_service.reports.free_run import curve_section, where_parts

if TYPE_CHECKING:
    from models.data.timeseries import TimeSeries
    from models.network.local_model_network import LocalModelNetwork

VERDICTS = {
    "missing": "an effect was found",
    "nothing_missing": "nothing is missing: the error is the model's own",
    "ambiguous": "these data cannot tell the effects below apart",
    "unknown_effect": "something is there that no known effect explains",
}
_ASKED = {
    "change": "The model was right once. What has changed since, in the cell or in the rig?",
    "structure": "Which effect does the model's structure lack?",
}
# An error that is larger than so many times the noise is more than noise to anybody.
_FAR_ABOVE_NOISE = 2.0
_SUREST, _LEAST = 0.999, 0.005


def diagnosis_report(
    heading: Heading,
    network: LocalModelNetwork,
    runs: Sequence[TimeSeries],
    initial_soc: Sequence[float],
    result: Mapping[str, Any],
    called: Mapping[str, str] | None = None,
) -> Report:
    """Put the report together; simulates the runs for its curves.

    Parameters
    ----------
    network, runs, initial_soc : what was diagnosed
    result : the `diagnose` object of the public contract
    called : what people call a run, by the name of its series
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.comparison.figures import compare
    from models.comparison.simulated_runs import simulate_runs

    names, compared = called or {}, compare(network, list(runs), list(initial_soc))
    sections = [_finding(finding, result["mode"]) for finding in result["findings"]]
    sections.append(Section("What stays open", _rest(result)))
    sections.append(Section("Where the model is off", where_parts(compared["regions"], compared["where"])))
    for each in simulate_runs(network, list(runs), list(initial_soc)):
        name = each.run.name
        sections.append(curve_section(each, None, f"Run {names.get(name, name)}"))
    return Report(heading, diagnosis_summary(result), sections)


def diagnosis_summary(result: Mapping[str, Any]) -> list[Part]:
    """The verdict in words, the surest figures, and the error as each finding would leave it."""
    parts: list[Part] = [_ASKED[result["mode"]], f"Verdict: {VERDICTS[result['verdict']]}."]
    findings = result["findings"]
    if findings:
        first = findings[0]
        before, after = first["error_before_mV"], first["error_after_mV"]
        keys = [Key("Named first", words.effect(first["effect"]), f"confidence {confidence(first['confidence'])}")]
        if after is not None:
            change = f"{words.millivolts(before)} → {words.millivolts(after)}"
            keys.append(
                Key("RMS error with it", change, f"explains {words.percent(first['explained_share'])} of its square")
            )
        keys += [Key(name.capitalize(), value, "as found") for name, value in words.parameters(first["parameters"])]
        parts.append(Keys(keys))
    drawn = error_bars(result)
    return [*parts, *([drawn] if drawn is not None else []), *usability_parts(result.get("usability"))]


def confidence(share: float) -> str:
    """Write a probability; none is ever certain, and what is a rival by its shape alone is not ruled out."""
    if share < _LEAST:
        return "below 1 %"
    return "above 99.9 %" if share > _SUREST else words.percent(share)


def left_over(result: Mapping[str, Any]) -> str:
    """What nothing in the answer explains, in words: "nothing is missing" does not mean that the model is good."""
    left_mV, noise_mV = result["unexplained_mV"], result["noise_floor_mV"]
    if left_mV is None:
        return ""
    text = f"Unexplained: {words.millivolts(left_mV)}"
    if noise_mV is None:
        return f"{text}."
    text += f", noise floor {words.millivolts(noise_mV)}."
    if result["verdict"] != "nothing_missing" or left_mV <= _FAR_ABOVE_NOISE * noise_mV:
        return text
    advice = {
        "change": "A change is told where it is larger than what these runs would have shown of it (power).",
        "structure": "Another structure or more training data come before any effect.",
    }
    share = 1.0 - (noise_mV / left_mV) ** 2
    whose = {
        "change": "no more than this model is off by from one run of the cell to another",
        "structure": "the model itself is off by that much",
    }
    own = f"{100 * share:.0f} % of its square is more than noise: {whose[result['mode']]}."
    return f"{text} {own} {advice[result['mode']]}"


def error_bars(result: Mapping[str, Any]) -> Figure | None:
    """Draw the error as it is and as each finding would leave it, with the noise floor as a line."""
    findings = [each for each in result["findings"] if each["error_after_mV"] is not None]
    if not findings:
        return None
    before = findings[0]["error_before_mV"]
    shown = [Bar("As the model is", before, words.millivolts(before), RUST)]
    for each in findings:
        after = each["error_after_mV"]
        shown.append(Bar(f"With: {words.effect(each['effect'])}", after, words.millivolts(after), BLUE))
    noise_mV = result["noise_floor_mV"]
    dashed = "" if noise_mV is None else f"; dashed: noise of the measurement, {words.millivolts(noise_mV)}"
    return bars(f"RMS error of the diagnosed runs{dashed}", shown, noise_mV)


def _finding(finding: Mapping[str, Any], mode: str) -> Section:
    rivals = [words.effect(name) for name in finding["confounded_with"]]
    what = "What is new" if mode == "change" else "What is missing"
    parts: list[Part] = [
        f"Confidence {confidence(finding['confidence'])}.",
        words.sentence(words.told(finding["explanation"])),
    ]
    rows = words.parameters(finding["parameters"])
    if rows:
        parts.append(Table(("Parameter", "Value ± standard deviation"), rows, frozenset({1})))
    if rivals:
        parts.append(f"These data cannot tell it from: {words.listed(rivals, 'or')}.")
    return Section(f"{what}, {finding['rank']}: {words.effect(finding['effect'])}", parts)


def _rest(result: Mapping[str, Any]) -> list[Part]:
    """What the remainder depends on, what to measure next, what could hide, remarks."""
    said = [
        f"The error depends on {words.variable(each['variable'])}: {words.percent(each['strength'])} of it."
        for each in result["depends_on"]
    ]
    said.append(left_over(result))
    if result["next_experiment"] is not None:
        rivals = [
            words.effect(rival) if isinstance(rival, str) else "a model"
            for rival in result["next_experiment"]["rivals"]
        ]
        said.append(f"Next experiment: a profile that tells {words.listed(rivals, 'from')}.")
    said += [words.sentence(words.told(each)) for each in result.get("remarks", [])]
    parts: list[Part] = [Points([text for text in said if text])]
    sizes = [(words.effect(each["effect"]), words.quantity(each["size"], each["unit"], digits=2))
             for each in result.get("power", [])]  # fmt: skip
    if sizes:
        parts.append("The smallest size of each effect that this diagnosis would have seen in nine cases of ten:")
        parts.append(Table(("Effect", "Size"), sizes, frozenset({1})))
    return parts
