"""What is latched, and what hides what."""

import pytest

from bench_service.bench.latch import INTERRUPTIONS, Latch
from bench_service.bench.limits import Limits
from bench_service.bench.settings import BenchSettings

LIMITS = Limits((2.0, 4.2), (-1.0, 1.0), (0.0, 45.0), (0.0, 1.0), None, 9.0)
CUT_OFF = Latch("interrupted", "run x was interrupted")
SETTINGS = BenchSettings("left", "modbus-tcp://h:1", "generic", LIMITS, latched=CUT_OFF, identity={"serial": "16"})


@pytest.mark.parametrize(
    ("state", "reason", "code"),
    [
        ("interrupted", "its control process has ended", "interrupted"),
        ("fault", "left: the recorder is gone; samples cannot be stored, output switched off", "recorder"),
        ("fault", "left: voltage 4.3 V is outside", "run_fault"),
    ],
)
def test_the_end_of_a_run_says_what_it_leaves(state: str, reason: str, code: str) -> None:
    assert Latch.of_run(state, reason) == Latch(code, reason)
    assert Latch.of_run("completed", None) is Latch.of_run("stopped", reason) is None


def test_what_takes_a_person_is_not_hidden_by_what_does_not() -> None:
    hot, other, ended = Latch("at_rest", "hot"), Latch("other_device", "another"), Latch("run_fault", "too warm")
    assert hot.over(None) == hot.over(CUT_OFF) == CUT_OFF.over(hot) == hot
    assert other.over(hot) == hot.over(other) == other
    assert ended.over(CUT_OFF) == CUT_OFF
    assert {hot.code, other.code, ended.code, "unknown"}.isdisjoint(INTERRUPTIONS)


def test_settings_carry_it() -> None:
    assert BenchSettings.from_json(SETTINGS.to_json()) == SETTINGS
