import math
from dataclasses import replace

import pytest

from bench_service.bench.at_rest import AtRest, look
from bench_service.bench.limits import Limits
from bench_service.bench.plausibility import band_of
from drivers.cycler import Reading

LIMITS = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.1, 0.9), None, 100.0)
BAND = band_of(2.5, LIMITS.voltage_V)
GOOD = Reading(1.0, 7, 3.7, 0.0, 25.0, 24.0, 0.0, False, frozenset(), frozenset())


def said(*readings: Reading, limits: Limits = LIMITS) -> list[tuple[bool, str]]:
    state, found = AtRest(), []
    for k, reading in enumerate(readings):
        state, notices = look(state, "b", limits, BAND, replace(reading, monotonic_s=0.5 * k))
        found += [notice.key for notice in notices]
    return found


def test_a_cell_at_rest_says_nothing() -> None:
    assert said(*[GOOD] * 5) == []


@pytest.mark.parametrize(
    ("change", "latch", "code"),
    [
        ({"temperature_degC": 102.0}, True, "temperature_limit"),
        ({"temperature_degC": -5.0}, False, "temperature_limit"),
        ({"temperature_degC": math.nan}, False, "temperature_missing"),
        ({"voltage_V": 4.3}, True, "voltage_limit"),
        ({"voltage_V": 0.01}, False, "voltage_limit"),
        ({"voltage_V": math.nan}, False, "voltage_limit"),
        ({"alarms": frozenset({"internal"})}, False, "device_alarm"),
        ({"output_on": True, "current_A": 1.0}, True, "unexpected_output"),
    ],
)
def test_what_is_wrong_is_said_once_while_it_holds(change: dict, latch: bool, code: str) -> None:
    bad = replace(GOOD, **change)
    assert said(bad, bad, bad) == [(latch, code)]
    assert said(bad, GOOD, bad).count((latch, code)) == 2


def test_a_cell_that_warms_up_by_itself_is_a_fault_where_it_is_hot() -> None:
    warming = [replace(GOOD, temperature_degC=20 + 0.5 * k) for k in range(80)]
    wide = replace(LIMITS, temperature_degC=(0.0, 90.0))
    assert said(*warming[:40]) == said(*warming[:40], limits=wide) == [(False, "temperature_rate")]
    assert said(*warming, limits=wide) == [(False, "temperature_rate"), (True, "temperature_rate")]
