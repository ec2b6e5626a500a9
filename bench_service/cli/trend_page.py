"""A cell's life as one self-contained page: capacity and resistance over its runs with bands, and what is new when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from bench_service.cli.report import page, table

_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _TOP = 900, 240, 70, 28, 12
# Colours of resistance at the lowest SoC, in the middle and at the highest.
_COLOURS = ("#0b62a8", "#3f7d20", "#c2410c")
_CAPACITY = "#0b62a8"
# Of what explains the error, and of what is left.
_EXPLAINED, _REST = ("#0b62a8", "#c2410c", "#3f7d20"), "#9aa4ae"
# Standard deviations of the bands: 95 %.
_BAND = 2.0

# Value and standard deviation of one run; None: not told.
Told = tuple[float, float] | None


def trend_page(model: str, result: Mapping[str, Any]) -> bytes:
    """Return the page as UTF-8.

    Parameters
    ----------
    model : the model's name
    result : the `trend` object of the public contract
    """
    runs = result["runs"]
    capacity: list[Told] = [(each["capacity_Ah"]["value"], each["capacity_Ah"]["std"]) for each in runs]
    told = sorted({each["soc"] for entry in runs for each in entry["resistance"]})
    places = dict.fromkeys((told[0], told[len(told) // 2], told[-1])) if told else ()
    drawn = [
        (f"SoC {soc:.1f}", colour, [_at(each, soc) for each in runs])
        for soc, colour in zip(places, _COLOURS, strict=False)
    ]
    rows = [
        {
            "run": each["run"],
            "capacity / Ah": each["capacity_Ah"]["value"],
            "std / Ah": each["capacity_Ah"]["std"],
            "what is new": in_words(each),
        }
        for each in runs
    ]
    parts = [
        f"<h1>{escape(model)}: {len(runs)} run(s) of a cell's life</h1>",
        "<p>Each run is held against the cell as it was; bands are two standard deviations. What is said to be new is "
        "borne out by the series as a whole: of all runs with a finding, at most 5 % are expected to be false.</p>",
        "<h2>Capacity / Ah</h2>",
        chart("Capacity in Ah over the runs", [("capacity", _CAPACITY, capacity)]),
        _ahead(result.get("forecast")),
        "<h2>Resistance of the first moment / mOhm</h2>",
        chart("Resistance in mOhm over the runs", drawn),
        "<h2>What explains the error / mV</h2>",
        stacked(runs),
        "<h2>What is new</h2>",
        _since(result.get("change_points", ())),
        table(("run", "capacity / Ah", "std / Ah", "what is new"), rows),
    ]
    return page(f"{model}: trend", parts)


def stacked(runs: Sequence[Mapping[str, Any]]) -> str:
    """SVG of one bar a run: the model's error as it was, cut into what each change explains and what is left."""
    most = max((each.get("error_mV") or 0.0 for each in runs), default=0.0)
    if not most:
        return "<p>None is told.</p>"
    names = sorted({finding["effect"] for each in runs for finding in each["findings"]})
    colours = dict(zip(names, _EXPLAINED, strict=False))
    width, marks = (_WIDTH - _LEFT - 20) / len(runs), []
    for number, each in enumerate(runs):
        x, top = _LEFT + width * (number + 0.15), float(each["error_mV"])
        for name, low in (*steps_of(each), ("left", 0.0)):
            y, tall = (_y_of(value, most) for value in (top, low))
            colour = colours.get(name, _REST)
            title = f"<title>{escape(each['run'])}: {escape(name)} {top - low:.1f} mV</title>"
            marks.append(
                f'<rect x="{x:.1f}" y="{y:.1f}" width="{0.7 * width:.1f}" height="{max(tall - y, 0.0):.1f}" '
                f'fill="{colour}">{title}</rect>'
            )
            top = min(top, low)
    for number, (name, colour) in enumerate((*colours.items(), ("left", _REST))):
        marks.append(f'<text x="{_LEFT + 140 * number}" y="{_TOP - 1}" style="fill:{colour}">{escape(name)}</text>')
    for value in (0.0, 0.5 * most, most):
        marks.append(f'<text x="{_LEFT - 8}" y="{_y_of(value, most) + 4:.1f}" text-anchor="end">{value:.3g}</text>')
    marks += [
        f'<text x="{_LEFT + width * (k + 0.5):.1f}" y="{_HEIGHT - 8}" text-anchor="middle">{k + 1}</text>'
        for k in _ticks(len(runs))
    ]
    title = "Error of the model in mV over the runs, by what explains it"
    return f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{title}">{"".join(marks)}</svg>'


def steps_of(entry: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Each named change with the error in mV that is left beside those before it."""
    return [(finding["effect"], float(finding["error_after_mV"])) for finding in entry["findings"] if _named(finding)]


def _named(finding: Mapping[str, Any]) -> bool:
    return finding.get("error_after_mV") is not None


def _y_of(value: float, most: float) -> float:
    return _TOP + (_HEIGHT - _TOP - _BOTTOM) * (1.0 - value / most)


def _ahead(forecast: Mapping[str, Any] | None) -> str:
    """When the end is reached, in words and as a curve."""
    if forecast is None:
        return "<p>When the end is reached is not told: too few runs.</p>"
    curve = forecast["curve"]
    values: list[Told] = [(each["capacity_Ah"], (each["high_Ah"] - each["low_Ah"]) / (2.0 * _BAND)) for each in curve]
    ends: list[Told] = [(forecast["end_Ah"], 0.0)] * len(curve)
    labels = [f"{each['at']:.0f}" for each in curve]
    lines = [("goes on as it did", _CAPACITY, values), ("end", _COLOURS[2], ends)]
    drawn = chart(f"Capacity in Ah over {forecast['unit']}", lines, labels)
    return f"<p>{escape(forecast['explanation'])}.</p>{drawn}"


def _since(points: Sequence[Mapping[str, Any]]) -> str:
    told = [
        f"<li>{escape(each['effect'])} since {escape(each['run'])}, between {escape(each['between'][0])} and "
        f"{escape(each['between'][1])}</li>"
        for each in points
    ]
    return f"<ul>{''.join(told)}</ul>" if told else ""


def in_words(entry: Mapping[str, Any]) -> str:
    """What a run's entry says is new."""
    if entry["verdict"] == "nothing_missing":
        return "nothing"
    if entry["verdict"] == "unknown_effect":
        return "something that no known effect explains"
    names = [
        f"resistance {finding['evidence']['where']}" if "where" in finding.get("evidence", {}) else finding["effect"]
        for finding in entry["findings"]
    ]
    return (" or " if entry["verdict"] == "ambiguous" else ", then ").join(names)


def where_told(entry: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The resistance of an entry that is known best."""
    return min(entry["resistance"], key=lambda each: each["std_Ohm"], default=None)


def chart(title: str, lines: Sequence[tuple[str, str, Sequence[Told]]], labels: Sequence[str] | None = None) -> str:
    """SVG of values over the number of the run, each with its band.

    Parameters
    ----------
    title : for those who do not see it
    lines : name, colour and values of each
    labels : of the places; None: they are counted
    """
    every = [told for _, _, values in lines for told in values if told is not None]
    if not every:
        return "<p>None is told.</p>"
    low = min(value - _BAND * std for value, std in every)
    high = max(value + _BAND * std for value, std in every)
    span = max(high - low, 1e-9)
    count = max(len(values) for _, _, values in lines)

    def x(number: int) -> float:
        return _LEFT + (_WIDTH - _LEFT - 20) * (number + 0.5) / count

    def y(value: float) -> float:
        return _TOP + (_HEIGHT - _TOP - _BOTTOM) * (high - value) / span

    marks = [
        f'<text x="{_LEFT - 8}" y="{y(value) + 4:.1f}" text-anchor="end">{value:.3g}</text>'
        f'<line x1="{_LEFT}" x2="{_WIDTH - 20}" y1="{y(value):.1f}" y2="{y(value):.1f}" stroke="#ddd"/>'
        for value in (low, low + 0.5 * span, high)
    ]
    marks += [
        f'<text x="{x(k):.1f}" y="{_HEIGHT - 8}" text-anchor="middle">{k + 1 if labels is None else labels[k]}</text>'
        for k in _ticks(count)
    ]
    for number, (name, colour, values) in enumerate(lines):
        points = [(x(k), told) for k, told in enumerate(values) if told is not None]
        upper = [f"{at:.1f},{y(value + _BAND * std):.1f}" for at, (value, std) in points]
        lower = [f"{at:.1f},{y(value - _BAND * std):.1f}" for at, (value, std) in reversed(points)]
        middle = [f"{at:.1f},{y(value):.1f}" for at, (value, _) in points]
        marks.append(f'<polygon points="{" ".join(upper + lower)}" fill="{colour}" fill-opacity="0.15"/>')
        marks.append(f'<polyline points="{" ".join(middle)}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
        marks += [f'<circle cx="{at.split(",")[0]}" cy="{at.split(",")[1]}" r="2.5" fill="{colour}"/>' for at in middle]
        marks.append(f'<text x="{_LEFT + 90 * number}" y="{_TOP - 1}" style="fill:{colour}">{escape(name)}</text>')
    return f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{escape(title)}">{"".join(marks)}</svg>'


def _ticks(count: int) -> range:
    """Numbers of the runs that are written below."""
    return range(0, count, max(1, -(-count // 12)))


def _at(entry: Mapping[str, Any], soc: float) -> Told:
    """Resistance in mOhm near a SoC; None where the run's entry has none."""
    near = min(entry["resistance"], key=lambda each: abs(each["soc"] - soc), default=None)
    if near is None or abs(near["soc"] - soc) > 0.06:
        return None
    return 1e3 * near["value_Ohm"], 1e3 * near["std_Ohm"]
