"""The cycler's rules, in simulated time."""

import numpy as np
import pytest

from simulators.catalogue import CELLS
from simulators.cell import Cell
from simulators.clocks import LockStepClock, WallClock
from simulators.cycler import Cycler, CyclerSettings, StateRefusedError, ValueRefusedError
from simulators.sensors import SensorParameters, Sensors


def cycler(*, watchdog: bool = True, soc: float = 0.5) -> Cycler:
    sensors = Sensors(SensorParameters(), np.random.default_rng(1))
    return Cycler(CyclerSettings(), Cell(CELLS["nmc"].parameters, soc), sensors, watchdog_enabled=watchdog)


def running(current_A: float, **options: bool) -> Cycler:
    device = cycler(**options)
    device.set_remote(True)
    device.set_output(True)
    device.set_current(current_A)
    return device


class HandClock:
    """A monotonic clock that is moved by hand."""

    def __init__(self) -> None:
        self.time_s = 100.0

    def __call__(self) -> float:
        return self.time_s


def test_set_point_flows_and_is_measured() -> None:
    device = running(2.0)
    device.advance(0.01)
    assert device.current_A == 2.0
    assert device.measurement.current_A == pytest.approx(2.0, abs=0.01)
    assert device.status == {"output_on", "remote"}


def test_nothing_flows_with_the_output_off() -> None:
    device = cycler()
    device.set_remote(True)
    device.set_current(2.0)
    device.advance(1.0)
    assert device.current_A == 0.0
    device.set_output(True)
    device.advance(0.01)
    assert device.current_A == 2.0


def test_switching_off_forgets_the_set_point() -> None:
    device = running(2.0)
    device.advance(0.1)
    device.set_output(False)
    device.set_output(True)
    device.advance(0.1)
    assert device.set_point_A == device.requested_A == device.current_A == 0.0


def test_ramp_limits_the_slope_and_says_so() -> None:
    device = running(2.0)
    device.ramp_A_per_s = 4.0
    device.advance(0.25)
    assert device.current_A == pytest.approx(1.0)
    assert "current_limited" in device.status
    device.advance(0.30)
    assert device.current_A == 2.0
    assert "current_limited" not in device.status


@pytest.mark.parametrize(
    ("limit", "value", "current_A", "alarm"),
    [
        ("voltage_high", 3.71, 4.0, "over_voltage"),
        ("voltage_low", 3.70, -4.0, "under_voltage"),
        ("temperature_high", 24.0, 0.0, "over_temperature"),
        ("temperature_low", 26.0, 0.0, "under_temperature"),
    ],
)
def test_broken_limit_trips_and_latches(limit: str, value: float, current_A: float, alarm: str) -> None:
    device = running(current_A)
    device.advance(0.01)
    assert not device.alarms
    device.set_limit(limit, value)
    device.advance(0.01)
    assert device.alarms == {alarm}
    assert not device.output_on
    assert device.current_A == device.set_point_A == 0.0
    with pytest.raises(StateRefusedError, match=alarm):
        device.check_output(remote=True, alarms=True)


def test_limits_do_not_trip_while_the_output_is_off() -> None:
    device = cycler()
    device.set_limit("voltage_high", 1.0)
    device.advance(0.1)
    assert not device.alarms


def test_lowered_current_limit_holds_the_set_point_and_trips_on_what_flows() -> None:
    device = running(4.0)
    device.advance(0.01)
    device.set_limit("current_high", 3.0)
    assert device.set_point_A == 3.0
    device.advance(0.01)
    assert device.current_A == 3.0
    assert "current_limited" in device.status
    device.ramp_A_per_s = 0.1  # now the current cannot follow the next limit at once
    device.set_limit("current_high", 1.0)
    device.advance(0.01)
    assert device.alarms == {"over_current"}
    assert device.current_A == 0.0


def test_set_points_that_are_refused() -> None:
    device = cycler()
    device.check_set_point(0.0)
    with pytest.raises(StateRefusedError, match="remote"):
        device.check_set_point(1.0)
    device.set_remote(True)
    device.set_limit("current_low", -2.0)
    device.check_set_point(-2.0)
    with pytest.raises(ValueRefusedError, match="-2.5 A"):
        device.check_set_point(-2.5)


def test_watchdog_trips_at_its_time_and_counts_no_charge_after_it() -> None:
    device = running(2.5)
    device.watchdog_s = 1.0
    device.heartbeat()
    device.advance(0.9)
    assert device.output_on
    device.advance(10.0)
    assert device.alarms == {"watchdog"}
    assert "watchdog_expired" in device.status
    assert device.measurement.current_A == pytest.approx(0.0, abs=0.01)
    assert device._cell.step(0.0, 0.0).soc == pytest.approx(0.5 + 2.5 * 1.0 / 3600 / 2.5, abs=1e-12)


def test_heartbeat_holds_the_watchdog_off() -> None:
    device = running(1.0)
    device.watchdog_s = 0.5
    for _ in range(20):
        device.heartbeat()
        device.advance(0.4)
    assert device.output_on
    assert not device.alarms


def test_wall_clock_counts_measuring_periods() -> None:
    now = HandClock()
    clock, device = WallClock(now, speed=1.0), cycler()
    assert not clock.poll(device)
    now.time_s += 0.0105
    assert clock.poll(device)
    assert device.sequence == 10
    now.time_s += 0.0006
    assert clock.poll(device)
    assert device.sequence == 11


def test_speed_multiplies_time() -> None:
    now = HandClock()
    clock, device = WallClock(now, speed=60.0), running(1.25, watchdog=False)
    now.time_s += 6.0
    clock.poll(device)
    assert device._cell.step(0.0, 0.0).soc == pytest.approx(0.5 + 0.5 * 0.1, abs=1e-6)


def test_long_pause_on_the_wall_clock_fires_the_watchdog_in_time() -> None:
    now = HandClock()
    clock, device = WallClock(now, speed=1.0), running(2.5)
    now.time_s += 3600.0
    clock.poll(device)
    assert device.alarms == {"watchdog"}
    assert device._cell.step(0.0, 0.0).soc == pytest.approx(0.5 + 2.5 * 2.0 / 3600 / 2.5, abs=1e-9)


def test_at_another_speed_the_watchdog_still_counts_wall_time() -> None:
    now = HandClock()
    clock, device = WallClock(now, speed=20.0), running(2.5)
    device.watchdog_s = 1.0
    for _ in range(5):  # 18 simulated seconds between heartbeats
        device.heartbeat()
        now.time_s += 0.9
        clock.poll(device)
        assert not device.alarms
    now.time_s += 60.0
    clock.poll(device)
    assert device.alarms == {"watchdog"}
    # The current flowed for 4.5 s and then for the second of the watchdog less what had passed, 20 times as long.
    flowed_s = 20.0 * (4.5 + 1.0 - 0.9)
    assert device._cell.step(0.0, 0.0).soc == pytest.approx(0.5 + 2.5 * flowed_s / 3600 / 2.5, abs=1e-6)


def test_lock_step_takes_a_repeat_or_the_next_tick() -> None:
    clock, device = LockStepClock(HandClock(), period_s=0.5), cycler(watchdog=False)
    clock.check_tick(1)
    clock.move_to(1, device)
    clock.check_tick(1)
    clock.move_to(1, device)
    assert device.sequence == 1
    for wrong in (0, 3):
        with pytest.raises(ValueRefusedError, match=f"tick {wrong} after 1"):
            clock.check_tick(wrong)
    clock.tick = 2**32 - 1
    clock.check_tick(0)
    clock.set_period(0.25)
    assert clock.tick == 0


def test_lock_step_trips_when_the_client_is_gone() -> None:
    now = HandClock()
    clock, device = LockStepClock(now), running(1.0, watchdog=False)
    clock.heard()
    now.time_s += 1.9
    assert not clock.poll(device)
    now.time_s += 0.2
    assert clock.poll(device)
    assert device.alarms == {"client_gone"}
    assert not device.output_on
