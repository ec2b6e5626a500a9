"""The page of a diagnosis: bars to scale, nothing unescaped, everything that the answer says."""

import re
from typing import Any
from xml.etree import ElementTree

from bench_service.cli.diagnosis_page import VERDICTS, error_bars, left_over


def answer(**changed: Any) -> dict[str, Any]:
    finding = {
        "effect": "hysteresis",
        "rank": 1,
        "error_before_mV": 10.0,
        "error_after_mV": 2.5,
        "explained_share": 0.94,
        "confidence": 0.97,
        "parameters": {"amplitude_V": {"value": 0.018, "std": 0.001, "unit": "V"}},
        "confounded_with": [],
        "explanation": "a < b",
    }
    return {"verdict": "missing", "findings": [finding], "noise_floor_mV": 1.0} | changed


def test_bars_are_as_long_as_the_errors() -> None:
    svg = re.search(r"<svg.*</svg>", error_bars(answer()))
    assert svg is not None
    drawn = ElementTree.fromstring(svg[0])
    before, after = (float(bar.attrib["width"]) for bar in drawn.iter("rect"))
    assert abs(after / before - 0.25) < 0.01
    line = next(drawn.iter("line"))
    first = next(drawn.iter("rect"))
    assert abs((float(line.attrib["x1"]) - float(first.attrib["x"])) / before - 0.1) < 0.01


def test_without_a_finding_or_a_noise_floor_nothing_is_drawn_for_it() -> None:
    assert error_bars(answer(findings=[])) == ""
    assert "<line" not in error_bars(answer(noise_floor_mV=None))


def test_every_verdict_has_words() -> None:
    assert set(VERDICTS) == {"missing", "nothing_missing", "ambiguous", "unknown_effect"}


def test_nothing_missing_in_a_coarse_model_says_how_much_is_left() -> None:
    def words(left_mV: float, verdict: str = "nothing_missing", mode: str = "structure") -> str:
        return left_over({"verdict": verdict, "mode": mode, "unexplained_mV": left_mV, "noise_floor_mV": 1.0})

    assert words(1.5) == "Unexplained: 1.50 mV, noise floor 1.00 mV."
    assert "99 % of its square is more than noise" in words(10.0) and "more training data" in words(10.0)
    assert "cannot be seen" in words(10.0, mode="change")
    assert "more than noise" not in words(10.0, verdict="missing")
    unknown = {"verdict": "nothing_missing", "mode": "change", "unexplained_mV": 3.0, "noise_floor_mV": None}
    assert left_over(unknown) == "Unexplained: 3.00 mV."
