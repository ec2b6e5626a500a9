"""Report of a cell's life: capacity and resistance over its runs with bands, and what is new when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bench_service.reports import words
from bench_service.reports.comparison import usability_parts
from bench_service.reports.document import Figure, Heading, Key, Keys, Part, Points, Report, Section, Table
from bench_service.reports.drawing import BLUE, GREEN, RUST, Axis, Line, Piece, curves, cut_bars, every, level

# No resistance is negative, however little a run says of it.
_RESISTANCE = "Resistance of the first moment, with 95 % bands, cut at zero"
# Standard deviations of the bands: 95 %.
_BAND = 2.0
_NEAR_SOC = 0.06
# Name of a parameter that is a share, before what it is of.
_SHARE = "share_lost"
# A loss of which the series does not say that there is one.
_NOT_TOLD = "not told from none"

# Value and standard deviation of one run; None: not told.
Told = tuple[float, float] | None


def life_report(heading: Heading, result: Mapping[str, Any], called: Mapping[str, str] | None = None) -> Report:
    """Put the report together.

    Parameters
    ----------
    result : the `trend` object of the public contract
    called : what people call a run, by its name in the answer
    """
    names = called or {}
    runs = [{**each, "run": names.get(each["run"], each["run"])} for each in result["runs"]]
    capacity: list[Told] = [(each["capacity_Ah"]["value"], each["capacity_Ah"]["std"]) for each in runs]
    places = sorted({each["soc"] for entry in runs for each in entry["resistance"]})
    shown = dict.fromkeys((places[0], places[len(places) // 2], places[-1])) if places else ()
    resistance = [(f"at {100.0 * soc:.0f} % state of charge", [_at(each, soc) for each in runs]) for soc in shown]
    at, unit = places_of(runs), words.plain(result.get("unit") or "run")
    heads = ("Run", "Capacity", "What is new")
    rows = [
        (each["run"], words.quantity(each["capacity_Ah"]["value"], "Ah", each["capacity_Ah"]["std"]), in_words(each))
        for each in runs
    ]
    sections = [
        Section("Capacity", [over_runs("Capacity, with 95 % band", [("capacity", capacity)], "Ah", at, unit),
                             *_ahead(result.get("forecast"))]),
        Section("Resistance", [over_runs(_RESISTANCE, resistance, "mΩ", at, unit, 0.0)]),
        Section("What the capacity was lost by", [lost_by(runs, result.get("fresh_capacity_Ah"), unit)]),
        Section("What explains the error", [explained(runs, unit)]),
        Section("What is new", [*_since(result.get("change_points", ()), names), *_open(result),
                                Table(heads, rows, frozenset({1}))]),
    ]  # fmt: skip
    about = (
        "Each run is held against the cell as it was. What is said to be new is borne out by the series as a whole: of "
        "all runs with a finding, at most 5 % are expected to be false."
    )
    return Report(heading, [about, _keys(runs, result), *usability_parts(result.get("usability"))], sections)


def _keys(runs: Sequence[Mapping[str, Any]], result: Mapping[str, Any]) -> Keys:
    first, last = runs[0]["capacity_Ah"], runs[-1]["capacity_Ah"]
    keys = [
        Key("Runs", words.count(len(runs)), f"{runs[0]['run']} to {runs[-1]['run']}" if len(runs) > 1 else ""),
        Key("Capacity now", words.quantity(last["value"], "Ah", last["std"]),
            f"{words.percent(last['value'] / first['value'], 1)} of that of the first run" if len(runs) > 1 else ""),
    ]  # fmt: skip
    found = [each for each in runs if each["verdict"] != "nothing_missing"]
    keys.append(Key("Runs with something new", words.count(len(found)), in_words(found[-1]) if found else ""))
    return Keys(keys)


def places_of(runs: Sequence[Mapping[str, Any]]) -> list[float]:
    """Where runs lie along the life; counted where their entries do not say it."""
    return [float(each.get("at", k + 1.0)) for k, each in enumerate(runs)]


def _bars(unit: str, runs: Sequence[Mapping[str, Any]]) -> Axis:
    """The axis under one bar a run."""
    places = places_of(runs)
    return Axis(unit, ticks=[(float(k), f"{places[k]:g}") for k in every(len(runs))])


def lost_by(runs: Sequence[Mapping[str, Any]], fresh_Ah: float | None, unit: str = "run") -> Figure | str:
    """Draw one bar a run: the capacity that is lost, in the colour of what it was lost by."""
    if fresh_Ah is None:
        return "The capacity of the cell as it was is not told."
    lost_Ah = [max(fresh_Ah - float(each["capacity_Ah"]["value"]), 0.0) for each in runs]
    if not any(lost_Ah):
        return "None is lost."
    columns = []
    for each, lost in zip(runs, lost_Ah, strict=True):
        causes = [_finding_in_words(finding).split(" (")[0] for finding in each["findings"] if _takes(finding)]
        columns.append([Piece((causes or [_NOT_TOLD])[0], lost, 0.0)])
    caption = f"Capacity lost since {fresh_Ah:.3g} Ah, by what it was lost by"
    return cut_bars(caption, columns, (_bars(unit, runs), Axis("lost", "Ah")), grey=_NOT_TOLD)


def _takes(finding: Mapping[str, Any]) -> bool:
    """Whether what was found takes capacity."""
    return bool(finding.get("evidence", {}).get("takes_capacity"))


def explained(runs: Sequence[Mapping[str, Any]], unit: str = "run") -> Figure | str:
    """Draw one bar a run: the model's error as it was, cut into what each change explains and what is left."""
    if not any(each.get("error_mV") for each in runs):
        return "No error is told."
    columns = []
    for each in runs:
        top, pieces = float(each.get("error_mV") or 0.0), []
        for name, foot in (*steps_of(each), ("left", 0.0)):
            pieces.append(Piece(words.effect(name) if name != "left" else name, top, min(top, foot)))
            top = min(top, foot)
        columns.append(pieces)
    caption = "RMS error of the model as it was, cut into what each change explains and what is left"
    return cut_bars(caption, columns, (_bars(unit, runs), Axis("error", "mV")))


def steps_of(entry: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Each named change with the error in mV that is left beside those before it."""
    return [
        (finding["effect"], float(finding["error_after_mV"]))
        for finding in entry["findings"]
        if finding.get("error_after_mV") is not None
    ]


def _ahead(forecast: Mapping[str, Any] | None) -> list[Part]:
    """When the end is reached, in words and as a curve."""
    if forecast is None:
        return ["When the end is reached is not told: too few runs."]
    curve = forecast["curve"]
    at = np.array([float(each["at"]) for each in curve])
    half = np.array([(each["high_Ah"] - each["low_Ah"]) / 2.0 for each in curve])
    middle = np.array([float(each["capacity_Ah"]) for each in curve])
    lines = [Line("as it goes on", at, middle, half, BLUE), level("end", at, float(forecast["end_Ah"]))]
    caption = "Capacity ahead, if it goes on as it did, with 95 % band"
    drawn = curves(caption, lines, Axis(words.plain(forecast["unit"])), Axis("capacity", "Ah"))
    return [words.sentence(words.told(forecast["explanation"])), drawn]


def _since(points: Sequence[Mapping[str, Any]], names: Mapping[str, str]) -> list[Part]:
    said = [
        f"{words.effect(each['effect'])} since run {names.get(each['run'], each['run'])}, between "
        f"{names.get(each['between'][0], each['between'][0])} and {names.get(each['between'][1], each['between'][1])}."
        for each in points
    ]
    return [Points(said)] if said else []


def _open(result: Mapping[str, Any]) -> list[Part]:
    said = to_settle(result)
    return [] if said is None else [said]


def in_words(entry: Mapping[str, Any]) -> str:
    """What a run's entry says is new."""
    if entry["verdict"] == "nothing_missing":
        return "nothing"
    if entry["verdict"] == "unknown_effect":
        return "something that no known effect explains"
    found = [_finding_in_words(finding) for finding in entry["findings"]]
    if entry["verdict"] != "ambiguous":
        return ", then ".join(found)
    rivals = [words.plain(rival) for finding in entry["findings"] for rival in finding.get("confounded_with", ())]
    return " or ".join(dict.fromkeys([*found, *rivals]))


def _finding_in_words(finding: Mapping[str, Any]) -> str:
    """A resistance with its place, a loss with its share and electrode, anything else by its name."""
    if "where" in finding.get("evidence", {}):
        return f"resistance {words.told(finding['evidence']['where'])}"
    for name, told in finding.get("parameters", {}).items():
        if name.startswith(_SHARE):
            return f"{words.plain(finding['effect'])}{name.removeprefix(_SHARE)} ({100.0 * told['value']:.0f} %)"
    return words.plain(finding["effect"])


def to_settle(result: Mapping[str, Any]) -> str | None:
    """Which experiment would tell apart what the last run leaves open; None: nothing is left open."""
    asked = result.get("next_experiment")
    if asked is None:
        return None
    hours = float(asked["duration_s"]) / 3600.0
    rivals = words.listed([words.effect(rival) for rival in asked["rivals"]], "from")
    return f"Next experiment: a profile of {hours:.0f} h that tells {rivals}."


def where_told(entry: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The resistance of an entry that is known best."""
    return min(entry["resistance"], key=lambda each: each["std_Ohm"], default=None)


def over_runs(
    caption: str,
    lines: Sequence[tuple[str, Sequence[Told]]],
    unit: str,
    at: Sequence[float],
    along: str = "run",
    least: float = -np.inf,
) -> Figure | str:
    """Draw values over the life, each with its band, which ends where nothing can be lower.

    Parameters
    ----------
    lines : name and values of each line, a value for each run
    unit : of the values
    at, along : places of the runs, and their unit
    least : that a value can have
    """
    drawn, colours = [], (BLUE, GREEN, RUST)
    for number, (name, values) in enumerate(lines):
        middle = np.array([np.nan if told is None else told[0] for told in values])
        half = np.array([np.nan if told is None else _BAND * told[1] for told in values])
        places = np.array(at, dtype=np.float64)
        drawn.append(Line(name, places, middle, half, colours[number % len(colours)], dots=True, least=least))
    if not drawn:
        return "None is told."
    ticks = [(float(at[k]), f"{at[k]:g}") for k in every(len(at))] if along == "run" else None
    return curves(caption, drawn, Axis(along, ticks=ticks), Axis(caption.split(",")[0].split()[0].lower(), unit))


def _at(entry: Mapping[str, Any], soc: float) -> Told:
    """Resistance in mOhm near a SoC; None where the run's entry has none."""
    near = min(entry["resistance"], key=lambda each: abs(each["soc"] - soc), default=None)
    if near is None or abs(near["soc"] - soc) > _NEAR_SOC:
        return None
    return 1e3 * near["value_Ohm"], 1e3 * near["std_Ohm"]
