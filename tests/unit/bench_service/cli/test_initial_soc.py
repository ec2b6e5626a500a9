"""Where runs start: as the user says, as the run says, by a rest, or at a guess."""

from argparse import Namespace
from dataclasses import replace

import numpy as np
import pytest

from bench_service.cli.errors import UsageError
from bench_service.cli.initial_soc import guessed_soc, initial_soc, judged_starts, starts_apart, stated_apart
from bench_service.cli.output import Output
from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.hand_network import network

# Under load from its first sample on, so that no rest tells anything.
RUN = TimeSeries(np.arange(60.0), np.full(60, 2.0), np.full(60, 3.9), np.full(60, 25.0), name="loaded")
KNOWN = replace(RUN, soc_ref=np.linspace(0.4, 0.41, 60), name="known")


def model():  # noqa: ANN201
    structure = Structure(0, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc"),), 1.0)
    return network(structure, np.array([[0.7, 0.02, 3.4]]))


def test_what_the_user_says_counts_for_all_or_for_each() -> None:
    assert initial_soc([KNOWN, RUN], (0.7,)) == [0.7, 0.7]
    assert initial_soc([KNOWN, RUN], (0.7, 0.2)) == [0.7, 0.2]
    assert initial_soc([KNOWN], (0.7,)) == [0.7]


@pytest.mark.parametrize(
    ("runs", "given", "wanted"),
    [([RUN], (0.1, 0.2), "give 1 value$"), ([RUN] * 3, (0.1, 0.2), "give 1 value or 3"), ([RUN], (), "has 0 values")],
)
def test_another_number_of_values_is_refused(runs: list[TimeSeries], given: tuple[float, ...], wanted: str) -> None:
    with pytest.raises(UsageError, match=wanted):
        initial_soc(runs, given)


@pytest.mark.parametrize(
    ("given", "train_given", "starts"),
    [
        ((0.7,), None, ([0.7], [0.7, 0.7])),
        ((0.1, 0.2, 0.3), None, ([0.1], [0.2, 0.3])),
        ((0.2, 0.3), (0.1,), ([0.1], [0.2, 0.3])),
        ((0.2,), (0.1,), ([0.1], [0.2, 0.2])),
        ((0.2, 0.3), None, ([0.4], [0.2, 0.3])),
        (None, (0.1,), ([0.1], [0.4, 0.4])),
    ],
)
def test_runs_to_learn_from_start_apart_from_those_that_judge(
    given: tuple[float, ...] | None, train_given: tuple[float, ...] | None, starts: tuple[list[float], list[float]]
) -> None:
    options = Namespace(initial_soc=given, train_initial_soc=train_given)
    assert starts_apart([KNOWN], [KNOWN, KNOWN], options, model(), Output(True)) == starts


def test_the_option_of_the_runs_to_learn_from_is_named_where_it_is_wrong() -> None:
    options = Namespace(initial_soc=(0.2,), train_initial_soc=(0.1, 0.2, 0.3))
    with pytest.raises(UsageError, match="--train-initial-soc has 3 values"):
        starts_apart([KNOWN], [KNOWN], options, model(), Output(True))


def test_a_run_with_a_reference_starts_there() -> None:
    assert initial_soc([KNOWN], None) == [0.4]
    assert initial_soc([KNOWN], None, model(), Output(True)) == [0.4]


@pytest.mark.parametrize("with_model", [False, True])
def test_a_run_that_tells_nothing_is_refused(with_model: bool) -> None:
    with pytest.raises(ModelError):
        initial_soc([RUN], None, model() if with_model else None)


def test_an_observer_starts_all_the_same_at_a_guess_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    output = Output(True)
    # Anywhere between empty and full: a half, with the deviation of an even distribution.
    assert guessed_soc([KNOWN, RUN], None, model(), output) == [(0.4, None), (0.5, 0.29)]
    output.result({}, lambda _console: None)
    assert "loaded: no soc_ref, no rest, no --initial-soc: the observer starts at 0.5" in capsys.readouterr().err


def test_an_observer_believes_what_the_user_says() -> None:
    assert guessed_soc([KNOWN, RUN], (0.9,), model(), Output(True)) == [(0.9, None), (0.9, None)]


def test_runs_that_judge_a_fit_wait_for_its_model_where_nothing_is_given(capsys: pytest.CaptureFixture[str]) -> None:
    assert stated_apart([KNOWN], [RUN], None) == ([0.4], None)
    assert stated_apart([KNOWN], [RUN], (0.1, 0.2)) == ([0.1], [0.2])
    rows = [
        {"run": "rested", "initial_soc": {"value": 0.7, "std": 0.01}},
        {"run": "known", "initial_soc": {"value": 0.4, "std": None}},
    ]
    output = Output(True)
    assert judged_starts(rows, output) == [0.7, 0.4]
    output.result({}, lambda _console: None)
    said = capsys.readouterr().err.splitlines()
    assert said == ["warning: rested: SoC at its start from the open-circuit voltage after a rest: 0.700 +- 0.010"]
