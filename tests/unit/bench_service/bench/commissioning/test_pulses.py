"""What pulses tell: the sign, the size, and that too little tells nothing."""

import math

import pytest

from bench_service.bench.commissioning.pulses import (
    PulseRow,
    StepSize,
    judge_cell,
    judge_resistor,
    judge_sign,
    steps_of,
)
from bench_service.bench.plausibility import band_of

BAND = band_of(2.5, (2.5, 4.2))
NOISE_V = 2e-4


def rows(resistance_Ohm: float = 0.03, gain: float = 1.0, size_A: float = 0.5, rest_V: float = 3.7) -> list[PulseRow]:
    """Pulses both ways, with a ripple of the voltage."""
    told = [0.0] * 5 + [size_A] * 10 + [0.0] * 10 + [-size_A] * 10 + [0.0] * 10
    return [
        PulseRow(0.1 * k, gain * told_A, rest_V + resistance_Ohm * told_A + NOISE_V * math.sin(2.0 * k), told_A)
        for k, told_A in enumerate(told)
    ]


def test_every_step_is_found_with_its_size() -> None:
    steps = steps_of(rows(), 0.3)
    assert [step.current_A for step in steps] == pytest.approx([0.5, -0.5, -0.5, 0.5])
    assert [step.resistance_Ohm for step in steps] == pytest.approx([0.03] * 4, abs=1e-3)
    assert judge_sign(steps, [0.5, -0.5, -0.5, 0.5], 0.01).outcome == "passed"
    passed = judge_cell(steps, BAND)
    assert passed.outcome == "passed" and passed.values["resistance_least_Ohm"] == pytest.approx(0.03, abs=1e-3)


def test_pulses_shorter_than_the_settling_time_are_judged_by_their_end() -> None:
    assert len(steps_of(rows(), 5.0)) == 4


@pytest.mark.parametrize(
    ("resistance_Ohm", "words"),
    [
        (-0.03, "falls when the cell is charged"),
        (9.0, "possible for this cell"),
        (1e-5, "not to be told from its noise"),
    ],
)
def test_what_no_cell_does_fails(resistance_Ohm: float, words: str) -> None:
    check = judge_cell(steps_of(rows(resistance_Ohm), 0.3), BAND)
    assert check.outcome == "failed" and words in check.text


@pytest.mark.parametrize(("gain", "words"), [(-1.0, "its sign is turned in the map"), (10.0, "check scale and sign")])
def test_a_current_that_does_not_follow_fails(gain: float, words: str) -> None:
    check = judge_sign(steps_of(rows(gain=gain), 0.3), [0.5, -0.5, -0.5, 0.5], 0.01)
    assert check.outcome == "failed" and words in check.text


def test_a_resistor_is_held_against_what_is_stated() -> None:
    steps = steps_of(rows(1.0, rest_V=0.0), 0.3)
    assert judge_resistor(steps, 1.05).outcome == "passed"
    wrong = judge_resistor(steps, 2.0)
    assert wrong.outcome == "failed" and "1 Ohm where 2 Ohm is stated" in wrong.text
    assert judge_resistor([], 1.0).outcome == "failed"
    assert judge_resistor([StepSize(0.5, 1e-5, 1e-4)], 1.0).text.startswith("a step of +0.5 A moved the voltage by")
