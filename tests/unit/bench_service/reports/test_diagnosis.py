"""The report of a diagnosis: bars to scale, names of effects as people know them, everything that the answer says."""

import re
from typing import Any
from xml.etree import ElementTree

from bench_service.reports.diagnosis import VERDICTS, confidence, diagnosis_report, error_bars, left_over
from bench_service.reports.document import Heading, render
from tests.unit.bench_service.reports.hand_result import NETWORK, RUN, SOC


def answer(**changed: Any) -> dict[str, Any]:
    finding = {
        "effect": "hysteresis",
        "rank": 1,
        "error_before_mV": 10.0,
        "error_after_mV": 2.5,
        "explained_share": 0.94,
        "confidence": 0.9999999,
        "parameters": {"amplitude_V": {"value": 0.018, "std": 0.001, "unit": "V"}},
        "confounded_with": ["series_resistance"],
        "explanation": "a < b at 25 degC, +- 3 mOhm of series_resistance",
    }
    rest = {"mode": "structure", "unexplained_mV": 2.5, "depends_on": [{"variable": "since_step_s", "strength": 0.4}]}
    rest |= {"next_experiment": {"rivals": ["hysteresis", "relaxation"]}, "remarks": ["no rest at the start"]}
    rest |= {"power": [{"effect": "current_offset", "size": 0.0064, "unit": "A"}]}
    return {"verdict": "missing", "findings": [finding], "noise_floor_mV": 1.0} | rest | changed


def test_bars_are_as_long_as_the_errors() -> None:
    figure = error_bars(answer())
    assert figure is not None and "1.00 mV" in figure.caption
    drawn = ElementTree.fromstring(figure.svg)
    before, after = (float(bar.attrib["width"]) for bar in drawn.iter("rect"))
    assert abs(after / before - 0.25) < 0.01
    assert "With: Voltage hysteresis" in {node.text for node in drawn.iter("text")}


def test_without_a_finding_or_a_noise_floor_nothing_is_drawn_for_it() -> None:
    assert error_bars(answer(findings=[])) is None
    figure = error_bars(answer(noise_floor_mV=None))
    assert figure is not None and "<line" not in figure.svg


def test_all_of_the_answer_is_in_the_report_in_words() -> None:
    text = render(diagnosis_report(Heading("Diagnosis", "t"), NETWORK, [RUN], [SOC], answer())).decode()
    for said in (
        "What is missing, 1: Voltage hysteresis",
        "above 99.9 %",
        "A &lt; b at 25 °C, ± 3 mΩ of series resistance",
        "18.0 ± 1.0 mV",
        "These data cannot tell it from: Contact or cable resistance.",
        "time since the last current step: 40 %",
        "Voltage hysteresis from Slow relaxation",
        "No rest at the start.",
        "6.4 mA",
        "Error, measured − model",
    ):
        assert said in text, said
    assert not re.search(
        r"[a-z]_[a-zA-Z]|\de[-+]\d|nan", re.sub(r"<style>.*?</style>|<svg.*?</svg>", "", text, flags=re.S)
    )


def test_no_probability_is_certain() -> None:
    assert [confidence(each) for each in (0.97, 0.99999, 0.002)] == ["97 %", "above 99.9 %", "below 1 %"]


def test_every_verdict_has_words() -> None:
    assert set(VERDICTS) == {"missing", "nothing_missing", "ambiguous", "unknown_effect"}


def test_nothing_missing_in_a_coarse_model_says_how_much_is_left() -> None:
    def words(left_mV: float, verdict: str = "nothing_missing", mode: str = "structure") -> str:
        return left_over({"verdict": verdict, "mode": mode, "unexplained_mV": left_mV, "noise_floor_mV": 1.0})

    assert words(1.5) == "Unexplained: 1.50 mV, noise floor 1.00 mV."
    assert "99 % of its square is more than noise" in words(10.0) and "more training data" in words(10.0)
    assert "from one run of the cell to another" in words(10.0, mode="change")
    assert "more than noise" not in words(10.0, verdict="missing")
    unknown = {"verdict": "nothing_missing", "mode": "change", "unexplained_mV": 3.0, "noise_floor_mV": None}
    assert left_over(unknown) == "Unexplained: 3.00 mV."
