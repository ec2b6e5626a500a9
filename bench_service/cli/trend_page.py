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
        "<h2>Resistance of the first moment / mOhm</h2>",
        chart("Resistance in mOhm over the runs", drawn),
        "<h2>What is new</h2>",
        table(("run", "capacity / Ah", "std / Ah", "what is new"), rows),
    ]
    return page(f"{model}: trend", parts)


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


def chart(title: str, lines: Sequence[tuple[str, str, Sequence[Told]]]) -> str:
    """SVG of values over the number of the run, each with its band.

    Parameters
    ----------
    title : for those who do not see it
    lines : name, colour and values of each
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
    marks += [f'<text x="{x(k):.1f}" y="{_HEIGHT - 8}" text-anchor="middle">{k + 1}</text>' for k in _ticks(count)]
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
