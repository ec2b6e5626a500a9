"""The report of a cell's life: curves to scale, nothing unescaped, every verdict in words."""

from typing import Any
from xml.etree import ElementTree

import pytest

from bench_service.reports.diagnosis import VERDICTS
from bench_service.reports.document import Figure, Heading, render
from bench_service.reports.life import explained, in_words, life_report, lost_by, over_runs, where_told

HEADING = Heading("Life", "a < b")


def entry(run: str, **changed: Any) -> dict[str, Any]:
    resistance = [{"soc": 0.5, "value_Ohm": 0.03, "std_Ohm": 0.001}, {"soc": 0.9, "value_Ohm": 0.02, "std_Ohm": 0.002}]
    out = {"run": run, "capacity_Ah": {"value": 2.0, "std": 0.01}, "resistance": resistance}
    return out | {"verdict": "nothing_missing", "findings": []} | changed


def page(result: dict[str, Any], called: dict[str, str] | None = None) -> str:
    return render(life_report(HEADING, result, called)).decode()


def test_points_stand_where_their_values_are() -> None:
    figure = over_runs("Capacity", [("a", [(1.0, 0.0), (2.0, 0.0), None, (3.0, 0.0)])], "Ah", [1, 2, 30, 40], "cycle")
    assert isinstance(figure, Figure)
    heights = [float(each.attrib["cy"]) for each in ElementTree.fromstring(figure.svg).iter("circle")]
    assert heights[0] - heights[1] == pytest.approx(heights[1] - heights[2], abs=0.2)
    assert heights[0] > heights[2]
    assert len(heights) == 3
    across = [float(each.attrib["cx"]) for each in ElementTree.fromstring(figure.svg).iter("circle")]
    assert (across[2] - across[0]) / (across[1] - across[0]) == pytest.approx(39.0, rel=0.05)


def test_nothing_told_is_said() -> None:
    assert isinstance(over_runs("Capacity", [("a", [None])], "Ah", [1]), str)
    assert isinstance(over_runs("Resistance", [], "mΩ", []), str)
    assert isinstance(explained([entry("x")]), str)


def test_a_name_is_escaped_and_every_run_is_called_what_people_call_it() -> None:
    text = page({"runs": [entry("first & last"), entry("second", resistance=[])]}, {"second": "the aged one"})
    assert "a &lt; b" in text and "first &amp; last" in text and "the aged one" in text and "second" not in text
    assert "100.0 % of that of the first run" in text and "2.000 ± 0.010 Ah" in text


def test_every_verdict_has_words() -> None:
    findings = [{"effect": "capacity"}, {"effect": "series_resistance"}]
    said = {each: in_words(entry("x", verdict=each, findings=findings)) for each in VERDICTS}
    assert said["missing"] == "capacity, then series resistance"
    assert said["ambiguous"] == "capacity or series resistance"

    one = [{"effect": "capacity", "confounded_with": ["ocv_shape"]}]
    assert in_words(entry("x", verdict="ambiguous", findings=one)) == "capacity or ocv shape"
    assert said["nothing_missing"] == "nothing"
    assert "no known effect" in said["unknown_effect"]


def test_a_loss_is_told_with_its_share_and_its_electrode() -> None:
    shares = {"share_lost of the negative electrode": {"value": 0.118, "std": 0.01, "unit": "1"}}
    findings = [{"effect": "active_material_loss", "parameters": shares}, {"effect": "capacity", "parameters": {}}]
    said = in_words(entry("x", verdict="missing", findings=findings))
    assert said == "active material loss of the negative electrode (12 %), then capacity"


def test_the_resistance_that_is_known_best_is_shown() -> None:
    best = where_told(entry("x"))
    assert best is not None and best["soc"] == 0.5
    assert where_told(entry("x", resistance=[])) is None


def test_bars_are_cut_into_what_explains_the_error() -> None:
    findings = [{"effect": "capacity", "error_after_mV": 10.0}, {"effect": "resistance_growth", "error_after_mV": 4.0}]
    figure = explained([entry("x", error_mV=40.0, verdict="missing", findings=findings)])
    assert isinstance(figure, Figure)
    heights = [float(each.attrib["height"]) for each in ElementTree.fromstring(figure.svg).iter("rect")]
    assert [each / heights[0] for each in heights] == pytest.approx([1.0, 0.2, 4.0 / 30.0], abs=0.01)
    assert [each.label for each in figure.legend][::2] == ["Capacity", "left"]


def test_a_lost_capacity_has_the_colour_of_what_it_was_lost_by() -> None:
    share = {"share_lost": {"value": 0.1, "std": 0.01, "unit": "1"}}
    took = {"takes_capacity": True}
    plain = [{"effect": "capacity", "evidence": took}]
    lithium = [{"effect": "resistance_growth"}, {"effect": "lithium_loss", "parameters": share, "evidence": took}]
    told = ((1.9, "nothing_missing", []), (1.8, "missing", plain), (1.6, "missing", lithium))
    runs = [
        entry("x", capacity_Ah={"value": ampere_hours, "std": 0.01}, verdict=verdict, findings=findings)
        for ampere_hours, verdict, findings in told
    ]
    figure = lost_by(runs, 2.0)
    assert isinstance(figure, Figure)
    bars = [each for each in ElementTree.fromstring(figure.svg).iter("rect") if float(each.attrib["width"]) < 300.0]
    heights = [float(each.attrib["height"]) for each in bars[-3:]]
    assert [each / heights[2] for each in heights] == pytest.approx([0.25, 0.5, 1.0], abs=0.01)
    assert len({each.attrib["fill"] for each in bars[-3:]}) == 3
    assert [each.label for each in figure.legend] == ["capacity", "lithium loss", "not told from none"]
    assert isinstance(lost_by(runs, None), str) and isinstance(lost_by(runs, 1.0), str)


def test_a_forecast_and_change_points_are_told() -> None:
    curve = [{"at": 10.0 * k, "capacity_Ah": 2.0 - 0.1 * k, "low_Ah": 1.8, "high_Ah": 2.1} for k in range(4)]
    ahead = {"unit": "cycle", "end_Ah": 1.6, "explanation": "1.6 Ah < soon", "curve": curve}
    point = {"effect": "capacity", "run": "b & c", "between": ["a", "b & c"]}
    text = page({"runs": [entry("a")], "forecast": ahead, "change_points": [point]})
    assert "1.6 Ah &lt; soon" in text and "Capacity since run b &amp; c" in text and text.count("<figure>") == 3
    assert "too few runs" in page({"runs": [entry("a")], "forecast": None})
