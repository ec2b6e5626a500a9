from dataclasses import replace

import numpy as np
import pytest

from bench_service.bench.admission import RefusedError, check_start, ticks_per_sample
from bench_service.bench.limits import Limits
from bench_service.bench.player import make_player
from bench_service.bench.request import RunRequest
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Capabilities

LIMITS = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.1, 0.9), None, 1000.0)
SETTINGS = BenchSettings("b", "modbus-tcp://127.0.0.1:1", "generic", LIMITS)
DEVICE = Capabilities("device", "1", (-4.0, 4.0), (0.0, 6.0), (0.1, 60.0), False, True, True, True)
REQUEST = RunRequest("r", 0.1, LIMITS, 3.0, np.array([0.0, 10.0]), np.array([1.0, 0.0]), initial_soc=0.5)


def start(settings: BenchSettings = SETTINGS, device: Capabilities = DEVICE, **change: object) -> None:
    request = replace(REQUEST, **change)
    check_start(settings, device, request, make_player(request.time_s, request.current_A, request.dt_s))


def test_a_good_request_is_admitted() -> None:
    start()
    start(initial_soc=None)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"current_A": np.array([4.5, 0.0])}, "4.5 A at 0 s, the device's"),
        ({"limits": replace(LIMITS, current_A=(-0.5, 0.5))}, "1 A at 0 s, the run's"),
        ({"limits": replace(LIMITS, temperature_degC=(0.0, 46.0))}, "temperature_degC"),
        ({"limits": replace(LIMITS, ramp_A_per_s=5.0)}, "5 A/s"),
        ({"limits": replace(LIMITS, duration_s=9.0)}, "9 s"),
        ({"initial_soc": 0.9, "capacity_Ah": 0.1}, "state of charge"),
        ({"initial_soc": float("nan")}, "initial state of charge"),
        ({"capacity_Ah": float("nan")}, "capacity"),
        ({"settle_s": -1.0}, "settling"),
        ({"stale_limit": 0}, "stale_limit"),
    ],
)
def test_bad_requests(change: dict, message: str) -> None:
    with pytest.raises(RefusedError, match=message):
        start(**change)


@pytest.mark.parametrize(
    ("settings", "device"),
    [
        (replace(SETTINGS, watchdog_s=2.5), DEVICE),
        (replace(SETTINGS, watchdog_s=float("nan")), DEVICE),
        (SETTINGS, replace(DEVICE, watchdog_s=None)),
    ],
)
def test_without_a_short_watchdog_an_interlock_is_needed(settings: BenchSettings, device: Capabilities) -> None:
    with pytest.raises(RefusedError, match="external_interlock"):
        start(settings, device)
    start(replace(settings, external_interlock=True), device)


def test_without_a_temperature_of_the_cell_nothing_starts() -> None:
    with pytest.raises(RefusedError, match=r"measures no temperature of the cell, so limits of 0 to 45 degC"):
        start(device=replace(DEVICE, has_temperature=False))


def test_watchdog_out_of_the_devices_range() -> None:
    with pytest.raises(RefusedError, match="outside the device's 1.5 to 60 s"):
        start(SETTINGS, replace(DEVICE, watchdog_s=(1.5, 60.0)))


def test_lock_step_that_the_device_has_not() -> None:
    with pytest.raises(RefusedError, match="lock-step"):
        start(replace(SETTINGS, lock_step=True))


@pytest.mark.parametrize(
    ("dt_s", "lock_step", "expected"),
    [(0.1, False, 1), (1 / 3, False, 1), (1.0, False, 3), (10.0, False, 30), (10.0, True, 1)],
)
def test_heartbeats_come_three_times_in_a_watchdog(dt_s: float, lock_step: bool, expected: int) -> None:
    assert ticks_per_sample(dt_s, 1.0, lock_step) == expected


def test_settings_and_request_survive_their_journey() -> None:
    assert BenchSettings.from_json(SETTINGS.to_json()) == SETTINGS
    back = RunRequest.from_frame(*REQUEST.to_frame())
    assert back.time_s.tolist() == REQUEST.time_s.tolist() and back.current_A.tolist() == REQUEST.current_A.tolist()
    assert (back.limits, back.run_id, back.initial_soc) == (LIMITS, "r", 0.5)
    with pytest.raises(ValueError, match="bytes"):
        RunRequest.from_frame(REQUEST.to_frame()[0], b"12345678")
