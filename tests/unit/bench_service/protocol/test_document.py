"""What is wrong with a protocol is told with the path to it, before anything is played."""

from __future__ import annotations

from typing import Any

import pytest

from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.document import read_protocol
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.program import Play, Window
from tests.unit.bench_service.protocol.protocol_rig import document, program_of

REST = {"step": "rest", "until": {"time_s": 60}}
UNTIL = {"voltage_V": 3, "rate_C": "C/20", "charge_share": 0.5}
WINDOW = Window((2.5, 4.2), (-10.0, 5.0))


@pytest.mark.parametrize(
    ("step", "told"),
    [
        ({"step": "nap"}, "unknown step at steps.0.step"),
        ({"step": "rest", "until": {"time_s": "60"}}, "a number is needed, not a text at steps.0.until.time_s"),
        ({"step": "rest", "until": {"time": 60}}, "unknown key at steps.0.until.time"),
        ({"step": "rest", "untli": {"time_s": 60}}, "unknown key at steps.0.untli"),
        ({"step": "rest"}, "the step has no end at steps.0.until"),
        ({"step": "rest", "until": {"voltage_V": 3}}, "the direction is not clear"),
        ({"step": "rest", "until": {"dV_dt_V_per_s": 1e-6}}, "a rest needs a time, too"),
        ({"step": "constant_current", "until": {"time_s": 1}}, "needs current_A or rate_C at steps.0"),
        ({"step": "constant_current", "rate_C": 1, "current_A": 1, "until": {"time_s": 1}}, "say the same thing"),
        (
            {"step": "constant_current", "rate_C": 9, "until": {"time_s": 1}},
            r"rate_C: 22.5 A, limit -10 to 5 A",
        ),
        ({"step": "constant_current", "rate_C": "C/x", "until": {"time_s": 1}}, "no C-rate"),
        ({"step": "constant_current", "rate_C": 1, "until": {"voltage_V": 4.2}}, r"steps.0.until.voltage_V: 4.2 V"),
        ({"step": "cc_cv", "rate_C": 1, "voltage_V": 4.3, "until": {"rate_C": 0.1}}, r"steps.0.voltage_V: 4.3 V"),
        ({"step": "loop", "count": 2, "steps": []}, "at least one step is needed at steps.0.steps"),
        ({"step": "loop", "count": 2, "steps": [{"step": "mark", "label": "x"}]}, "a loop in which nothing is played"),
        ({"step": "loop", "count": 0, "steps": [REST]}, "steps.0.count"),
        ({"step": "goto", "to": "nowhere", "most": 2}, "there is no such label"),
        ({"step": "goto", "to": "nowhere"}, "goto needs to, a label, and most"),
        ({"step": "profile", "time_s": [0, 2, 1], "current_A": [0, 0, 0]}, "times must start at 0 and rise"),
        ({"step": "profile", "time_s": [0, 1], "current_A": [99, 0]}, r"current_A.0: 99 A"),
        ({"step": "group", "until": {"time_s": 5}, "steps": [REST]}, "no condition between steps"),
        ({"step": "design", "request": {}}, "has not been made yet"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(step: dict[str, Any], told: str) -> None:
    with pytest.raises(ProtocolError, match=told):
        compile_protocol(read_protocol(document(REST, step) if step["step"] == "goto" else document(step)), 2.5, WINDOW)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"schema": "other"}, "no protocol of this program"),
        ({"name": ""}, "a text is needed"),
        ({"record": {"time_s": 0}}, "must be above 0"),
        ({"record": {"time_s": 10**400}}, "outside what is allowed at record.time_s"),
        ({"limits": {"voltage_V": [4, 3]}}, "low must be below high"),
        ({"steps": "none"}, "an array of at least one step"),
        ({"colour": "blue"}, "unknown key at colour"),
    ],
)
def test_what_is_wrong_around_the_steps(more: dict[str, Any], told: str) -> None:
    with pytest.raises(ProtocolError, match=told):
        read_protocol(document(REST) | more)


def test_rates_take_the_capacity_and_groups_hand_on_limits_and_record_times() -> None:
    group = {"step": "group", "record": {"time_s": 5}, "limits": {"temperature_degC": [0, 40]}, "steps": [
        {"step": "constant_current", "rate_C": "D/2", "until": UNTIL}]}  # fmt: skip
    play = program_of([group]).instructions[0]
    assert isinstance(play, Play)
    assert play.level == -1.25 and play.record.time_s == 5 and play.limits == (("temperature_degC", 0.0, 40.0),)
    ends = [(e.quantity, e.above, e.value) for e in play.ends]
    assert ends == [("voltage_V", False, 3.0), ("current_A", False, 0.125), ("charge_Ah", True, 1.25)]
