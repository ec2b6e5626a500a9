"""The page of a cell's life: curves to scale, nothing unescaped, every verdict in words."""

from typing import Any
from xml.etree import ElementTree

import pytest

from bench_service.cli.diagnosis_page import VERDICTS
from bench_service.cli.trend_page import chart, in_words, stacked, trend_page, where_told


def entry(run: str, **changed: Any) -> dict[str, Any]:
    resistance = [{"soc": 0.5, "value_Ohm": 0.03, "std_Ohm": 0.001}, {"soc": 0.9, "value_Ohm": 0.02, "std_Ohm": 0.002}]
    out = {"run": run, "capacity_Ah": {"value": 2.0, "std": 0.01}, "resistance": resistance}
    return out | {"verdict": "nothing_missing", "findings": []} | changed


def test_points_stand_where_their_values_are() -> None:
    drawn = ElementTree.fromstring(chart("t", [("a", "#000", [(1.0, 0.0), (2.0, 0.0), None, (3.0, 0.0)])]))
    heights = [float(each.attrib["cy"]) for each in drawn.iter("circle")]
    assert heights[0] - heights[1] == pytest.approx(heights[1] - heights[2], abs=0.2)
    assert heights[0] > heights[2]
    assert len(heights) == 3


def test_nothing_told_is_said() -> None:
    assert "<svg" not in chart("t", [("a", "#000", [None])])


def test_a_name_is_escaped_and_every_run_is_there() -> None:
    text = trend_page("a < b", {"runs": [entry("first & last"), entry("second", resistance=[])]}).decode()
    assert "a &lt; b" in text and "first &amp; last" in text and "second" in text


def test_every_verdict_has_words() -> None:
    findings = [{"effect": "capacity"}, {"effect": "series_resistance"}]
    said = {each: in_words(entry("x", verdict=each, findings=findings)) for each in VERDICTS}
    assert said["missing"] == "capacity, then series_resistance"
    assert said["ambiguous"] == "capacity or series_resistance"
    assert said["nothing_missing"] == "nothing"
    assert "no known effect" in said["unknown_effect"]


def test_the_resistance_that_is_known_best_is_shown() -> None:
    best = where_told(entry("x"))
    assert best is not None and best["soc"] == 0.5
    assert where_told(entry("x", resistance=[])) is None


def test_bars_are_cut_into_what_explains_the_error() -> None:
    findings = [{"effect": "capacity", "error_after_mV": 10.0}, {"effect": "resistance_growth", "error_after_mV": 4.0}]
    drawn = ElementTree.fromstring(stacked([entry("x", error_mV=40.0, verdict="missing", findings=findings)]))
    heights = [float(each.attrib["height"]) for each in drawn.iter("rect")]
    assert [each / heights[0] for each in heights] == pytest.approx([1.0, 0.2, 4.0 / 30.0], abs=0.01)
    assert "<svg" not in stacked([entry("x")])


def test_a_forecast_and_change_points_are_told() -> None:
    curve = [{"at": 10.0 * k, "capacity_Ah": 2.0 - 0.1 * k, "low_Ah": 1.8, "high_Ah": 2.1} for k in range(4)]
    ahead = {"unit": "cycle", "end_Ah": 1.6, "explanation": "1.6 Ah < soon", "curve": curve}
    point = {"effect": "capacity", "run": "b & c", "between": ["a", "b & c"]}
    text = trend_page("m", {"runs": [entry("a")], "forecast": ahead, "change_points": [point]}).decode()
    assert "1.6 Ah &lt; soon" in text and "capacity since b &amp; c" in text and text.count("<svg") == 3
    assert "too few runs" in trend_page("m", {"runs": [entry("a")], "forecast": None}).decode()
