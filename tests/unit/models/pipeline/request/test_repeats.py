"""A run that was given twice is used once, and said."""

from dataclasses import replace

from models.pipeline.request.fit_request import FitRequest
from models.pipeline.request.repeats import without_repeats
from tests.unit.models.pipeline.usability.hand_data import CAPACITY_AH, pulses, run

ONE, OTHER = run(pulses(200), 0.6, name="one"), run(pulses(220), 0.5, name="other")
COPY = replace(ONE, name="copy")


def test_a_run_given_twice_is_used_once() -> None:
    request = FitRequest(train=[ONE, COPY, OTHER], capacity_Ah=CAPACITY_AH, initial_soc=[0.6, 0.6, 0.5])
    found = without_repeats(request)
    assert found.request.train == [ONE, OTHER]
    assert found.request.initial_soc == [0.6, 0.5]
    assert found.place == [0, 0, 1]
    assert found.remarks == ["copy is the same record as one: it is used once"]


def test_runs_of_their_own_are_left() -> None:
    request = FitRequest(train=[ONE, OTHER], capacity_Ah=CAPACITY_AH, validate=[COPY])
    found = without_repeats(request)
    assert found.request is request
    assert found.place == [0, 1]
    assert "also learned from" in found.remarks[0]
    assert without_repeats(replace(request, validate=None)).remarks == []
