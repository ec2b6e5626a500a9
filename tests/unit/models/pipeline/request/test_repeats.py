"""A run that was given twice is used once, and said."""

from dataclasses import replace

import pytest

from models.data.errors import ModelError
from models.pipeline.request.fit_request import FitRequest
from models.pipeline.request.repeats import without_repeats
from tests.unit.models.pipeline.usability.hand_data import CAPACITY_AH, pulses, run

ONE, OTHER = run(pulses(200), 0.6, name="one"), run(pulses(220), 0.5, name="other")
COPY = replace(ONE, name="copy")


def test_a_run_given_twice_is_used_once() -> None:
    request = FitRequest(train=[ONE, COPY, OTHER], capacity_Ah=CAPACITY_AH, initial_soc=[0.6, 0.6, 0.5])
    found = without_repeats(request)
    assert sorted(run.name for run in found.request.train) == ["one", "other"]
    taken = [(found.request.train[k].name, (found.request.initial_soc or [])[k]) for k in found.place]
    assert taken == [("one", 0.6), ("one", 0.6), ("other", 0.5)]
    assert found.remarks == ["copy is the same record as one: it is used once"]


def test_runs_of_their_own_are_left() -> None:
    request = FitRequest(train=[ONE, OTHER], capacity_Ah=CAPACITY_AH, validate=[COPY])
    found = without_repeats(request)
    assert [found.request.train[k].name for k in found.place] == ["one", "other"]
    assert "also learned from" in found.remarks[0]
    assert without_repeats(replace(request, validate=None)).remarks == []


def test_the_order_in_which_runs_were_named_does_not_matter() -> None:
    there = without_repeats(FitRequest(train=[ONE, OTHER], capacity_Ah=CAPACITY_AH, initial_soc=[0.6, 0.5])).request
    back = without_repeats(FitRequest(train=[OTHER, ONE], capacity_Ah=CAPACITY_AH, initial_soc=[0.5, 0.6])).request
    assert [run.name for run in there.train] == [run.name for run in back.train]
    assert there.initial_soc == back.initial_soc


def test_each_run_needs_its_own_start() -> None:
    request = FitRequest(train=[ONE, OTHER], capacity_Ah=CAPACITY_AH, initial_soc=[0.6])
    with pytest.raises(ModelError, match=r"1 initial SoC\(s\) for 2 training run\(s\)"):
        without_repeats(request)
