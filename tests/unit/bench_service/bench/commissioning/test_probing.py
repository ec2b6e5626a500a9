"""The first look: each reading that cannot be true is named, and nothing else."""

import math
from dataclasses import replace
from typing import Any

import pytest

from bench_service.bench.commissioning.check import ProofOrder, failed
from bench_service.bench.commissioning.probing import alarms, judge, tick_s
from bench_service.bench.limits import Limits
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Capabilities, Reading

LIMITS = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.0, 1.0), None, 100.0)
SETTINGS = BenchSettings("b", "modbus-tcp://h:1", "generic", LIMITS)
DEVICE = Capabilities("device", "17", (-30.0, 30.0), (0.0, 6.0), (0.1, 60.0), False, True, True, True)
CELL = ProofOrder()
AT_REST = Reading(0.0, 0, 3.7, 0.0, 25.0, 24.0, 0.0, False, frozenset(), frozenset())


def outcomes(
    reading: Reading = AT_REST, device: Capabilities = DEVICE, order: ProofOrder = CELL, **settings: Any
) -> dict[str, str]:
    readings = [replace(reading, sequence=reading.sequence + k) for k in range(4)]
    checks = judge(readings, device, replace(SETTINGS, **settings), order)
    assert (failed(checks) is None) == all(check.outcome != "failed" for check in checks)
    return {check.name: check.outcome for check in checks if check.outcome != "passed"}


def test_a_cell_at_rest_on_a_sound_device_is_all_right() -> None:
    assert outcomes() == {}


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"voltage_V": 37.0}, "voltage"),
        ({"voltage_V": math.nan}, "voltage"),
        ({"current_A": 0.5}, "current"),
        ({"output_on": True}, "current"),
        ({"temperature_degC": 250.0}, "temperature"),
        ({"temperature_degC": 2.5}, "temperature"),
        ({"temperature_degC": math.nan}, "temperature"),
    ],
)
def test_a_reading_that_cannot_be_true_fails(changes: dict[str, Any], name: str) -> None:
    assert outcomes(replace(AT_REST, **changes)) == {name: "failed"}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"serial": ""}, {"identity": "absent"}),
        ({"has_sequence": False}, {"measuring": "absent"}),
        ({"lock_step": True}, {"measuring": "absent"}),
        ({"watchdog_s": None}, {"watchdog_range": "failed"}),
        ({"watchdog_s": (5.0, 60.0)}, {"watchdog_range": "failed"}),
        ({"has_temperature": False}, {"temperature": "failed"}),
        ({"voltage_V": (0.0, 2.0)}, {"ranges": "failed"}),
    ],
)
def test_what_a_device_lacks_is_told(changes: dict[str, Any], expected: dict[str, str]) -> None:
    assert outcomes(device=replace(DEVICE, **changes)) == expected


def test_in_lock_step_the_last_run_is_still_to_be_seen() -> None:
    lock_step = replace(DEVICE, lock_step=True)
    assert outcomes(replace(AT_REST, current_A=2.0), lock_step) == {"measuring": "absent", "current": "absent"}


def test_a_declared_interlock_stands_in_for_a_watchdog() -> None:
    assert outcomes(device=replace(DEVICE, watchdog_s=None), external_interlock=True) == {"watchdog_range": "absent"}


def test_a_resistor_without_current_is_at_zero_volts() -> None:
    order = ProofOrder(resistor_Ohm=1.0)
    assert outcomes(replace(AT_REST, voltage_V=0.01), order=order) == {}
    assert outcomes(order=order) == {"voltage": "failed"}


def test_measurements_that_stand_still_are_found() -> None:
    checks = {check.name: check for check in judge([AT_REST] * 3, DEVICE, SETTINGS, ProofOrder())}
    assert checks["measuring"].outcome == "failed"


def test_alarms_are_named() -> None:
    (check,) = alarms([replace(AT_REST, alarms=frozenset({"watchdog"}))])
    assert check.outcome == "failed" and "watchdog" in check.text
    assert list(alarms([AT_REST])) == []


def test_a_slow_link_is_played_slowly_but_within_the_watchdog() -> None:
    assert tick_s(0.001, SETTINGS) == 0.1
    assert tick_s(0.05, SETTINGS) == pytest.approx(0.2)
    assert tick_s(1.0, SETTINGS) == pytest.approx(1.0 / 3.0)
