"""The answer as the public contract writes it."""

import json

import pytest

from models.diagnosis.answer.findings import Diagnosis, Finding
from models.diagnosis.evidence.parameters import Value

FINDING = Finding(
    "hysteresis",
    1,
    10.0,
    5.0,
    0.9,
    {"amplitude_V": Value(0.01, None, "V")},
    ("relaxation",),
    "in words",
    {"beside": []},
)


def test_the_explained_share_is_that_of_the_squared_error() -> None:
    assert FINDING.explained_share == pytest.approx(0.75)
    worse = Finding("capacity", 2, 4.0, 6.0, 0.1, {}, (), "")
    assert worse.explained_share == pytest.approx(-1.25)


@pytest.mark.parametrize("before_mV", [0.0, float("nan")])
def test_nothing_is_explained_of_no_error(before_mV: float) -> None:
    assert Finding("capacity", 1, before_mV, 0.0, 0.1, {}, (), "").explained_share == 0.0


def test_a_finding_is_written_with_the_names_of_the_contract() -> None:
    assert FINDING.to_json() == {
        "effect": "hysteresis",
        "rank": 1,
        "error_before_mV": 10.0,
        "error_after_mV": 5.0,
        "explained_share": 0.75,
        "confidence": 0.9,
        "parameters": {"amplitude_V": {"value": 0.01, "std": None, "unit": "V"}},
        "confounded_with": ["relaxation"],
        "explanation": "in words",
        "evidence": {"beside": []},
    }


def test_an_answer_is_plain_json() -> None:
    answer = Diagnosis("ambiguous", "change", (FINDING,), None, 4.5, (("soc", 0.3),), {"seed": 0}, 1.5, ("a remark",))
    document = answer.to_json()
    assert json.loads(json.dumps(document)) == document
    assert document["depends_on"] == [{"variable": "soc", "strength": 0.3}]
    assert document["remarks"] == ["a remark"] and document["noise_floor_mV"] is None
    assert document["findings"] == [FINDING.to_json()]
    assert (document["verdict"], document["mode"]) == ("ambiguous", "change")
