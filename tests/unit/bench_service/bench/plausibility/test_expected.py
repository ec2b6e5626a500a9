"""A voltage beside what a model expects: said at once, ended where it lasts, forgotten where it comes back."""

import math

import pytest

from bench_service.bench.plausibility import ExpectedVoltage
from bench_service.bench.plausibility.expected import follow, judge

BAND = ExpectedVoltage(1.0, [3.5] * 10 + [3.4] * 20, [3.7] * 10 + [3.6] * 20, margin_V=0.05, for_s=3.0)


@pytest.mark.parametrize(
    ("position_s", "voltage_V", "beyond_V"),
    [(5.0, 3.6, 0.0), (5.0, 3.8, 0.1), (5.0, 3.4, 0.1), (9.0, 3.65, 0.0), (10.0, 3.65, 0.0), (12.0, 3.65, 0.05),
     (1e6, 3.7, 0.1), (-1.0, 3.5, 0.0)],
)  # fmt: skip
def test_a_step_may_come_a_point_early_or_late(position_s: float, voltage_V: float, beyond_V: float) -> None:
    assert BAND.beyond_V(position_s, voltage_V) == pytest.approx(beyond_V)


def stages(voltages_V: list[float]) -> list[str | None]:
    since_s, found = math.nan, []
    for position_s, voltage_V in enumerate(voltages_V):
        since_s = follow(since_s, BAND, position_s, voltage_V)
        finding = judge(since_s, BAND, position_s, voltage_V)
        found.append(finding and finding.stage)
    return found


def test_it_warns_then_ends_the_run() -> None:
    assert stages([3.6, 3.8, 3.8, 3.8, 3.8]) == [None, "warn", "warn", "warn", "trip"]


def test_what_comes_back_within_the_margin_begins_anew() -> None:
    assert stages([3.8, 3.8, 3.74, 3.8, 3.8, 3.8]) == ["warn", "warn", None, "warn", "warn", "warn"]


def test_it_says_how_far_and_for_how_long() -> None:
    finding = judge(2.0, BAND, 5.0, 3.8)
    assert finding is not None and finding.code == "model_band"
    assert finding.text == (
        "voltage 3.8000 V has been over 50 mV outside of the model's band for 3 s, now by 100 mV; allowed are 3 s"
    )
