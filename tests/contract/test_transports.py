"""What a bench may rely on, the same over every transport: the `Cycler` protocol against the simulated cycler."""

import math
import time

import pytest

from drivers.cycler import (
    CyclerConnectionError,
    CyclerError,
    CyclerProtocolError,
    DeviceLimits,
    SetPointRefusedError,
)
from tests.protocol.raw_modbus import HandClock
from tests.protocol.rigs import LIMITS, TRANSPORTS, rig

every = pytest.mark.parametrize("transport", TRANSPORTS)


@every
async def test_a_life_in_lock_step(transport):
    async with rig(transport) as made:
        driver, cycler = made.driver, made.device.cycler
        able = await driver.connect()
        assert able.current_A == (-30.0, 30.0) and able.voltage_V == (0.0, 6.0)
        assert able.watchdog_s == (0.1, 60.0) and able.serial == "1"
        assert able.lock_step and able.has_sequence and able.has_device_limits and able.has_ramp
        await driver.acquire(LIMITS, 1.5, 0.1)
        assert cycler.remote and made.at_rest and cycler.watchdog_s == 1.5
        assert cycler.limits == {
            "voltage_high": 4.25, "voltage_low": 2.5, "current_high": 10.0, "current_low": -10.0,
            "temperature_high": 60.0, "temperature_low": -10.0,
        }  # fmt: skip
        await driver.output(True)
        first = await driver.sample()
        assert first.output_on and not first.alarms
        for k, current_A in enumerate((1.0, -2.5, 0.1), start=1):
            await driver.apply(current_A)
            reading = await driver.sample()
            assert reading.sequence == first.sequence + k
            assert reading.setpoint_in_force_A == pytest.approx(current_A, rel=1e-6)
            assert reading.current_A == pytest.approx(current_A, abs=0.02)
            assert 2.5 < reading.voltage_V < 4.25
            assert reading.temperature_degC == pytest.approx(25, abs=0.5)
        await driver.safe()
        assert made.at_rest
        await driver.release()
        assert not cycler.remote


@every
async def test_on_the_wall_clock(transport):
    async with rig(transport, lock_step=False) as made:
        before = await made.running(-1.0)
        for _ in range(20):
            await made.driver.apply(2.0)
            after = await made.driver.sample()
        assert after.setpoint_in_force_A == 2.0 and after.sequence != before.sequence
        await made.driver.output(False)
        assert made.at_rest


@every
async def test_the_same_commands_give_the_same_samples(transport):
    seen = []
    for _ in range(2):
        async with rig(transport, seed=5) as made:
            await made.acquired()
            await made.driver.output(True)
            readings = []
            for k in range(20):
                reading = await made.driver.sample()
                readings.append((reading.sequence, reading.voltage_V, reading.current_A, reading.temperature_degC))
                await made.driver.apply(math.sin(k))
            seen.append(readings)
    assert seen[0] == seen[1]


async def test_every_transport_measures_the_same():
    last = {}
    for transport in TRANSPORTS:
        async with rig(transport, seed=3) as made:
            await made.running(-2.5)
            for _ in range(50):
                await made.driver.apply(-2.5)
                reading = await made.driver.sample()
            last[transport] = (reading.sequence, reading.voltage_V, reading.current_A, reading.temperature_degC)
    for transport in TRANSPORTS[1:]:
        assert last[transport] == pytest.approx(last[TRANSPORTS[0]], abs=1e-6)


@every
@pytest.mark.parametrize("current_A", [math.nan, math.inf, -math.inf, 31.0, 1e9])
async def test_impossible_set_points_change_nothing(transport, current_A):
    async with rig(transport) as made:
        before = await made.running(2.0)
        with pytest.raises(SetPointRefusedError, match="not sent"):
            await made.driver.apply(current_A)
        assert made.device.cycler.set_point_A == 2.0
        await made.driver.apply(1.0)  # and the next one is taken as if nothing had been
        assert (await made.driver.sample()).sequence == before.sequence + 1


@every
async def test_a_set_point_beyond_the_limits_in_the_device(transport):
    async with rig(transport) as made:
        await made.running()
        with pytest.raises((CyclerProtocolError, SetPointRefusedError)):
            await made.driver.apply(20.0)
        await made.driver.safe()
        assert made.at_rest


@every
async def test_the_device_holds_a_voltage_that_it_was_told(transport):
    async with rig(transport) as held:
        before = await held.running(2.0)
        assert (await held.driver.connect()).has_hold
        await held.running(2.0)
        hold_V = round(before.voltage_V + 0.005, 4)
        for _ in range(20):
            await held.driver.apply(9.0, hold_V)
            seen = await held.driver.sample()
        assert seen.voltage_V == pytest.approx(hold_V, abs=0.006) and 0.5 < seen.current_A < 9.0
        assert "voltage_held" in seen.status and seen.setpoint_in_force_A == pytest.approx(9.0, rel=1e-6)
        assert held.device.cycler.hold_V == pytest.approx(hold_V, abs=1e-6)
        await held.driver.apply(2.0)
        assert held.device.cycler.hold_V is None, "what is told no more is held no more"
        with pytest.raises(SetPointRefusedError):
            await held.driver.apply(2.0, 99.0)
        await held.driver.apply(2.0, hold_V)
        await held.acquired()
        assert held.device.cycler.hold_V is None


@every
async def test_the_clock_must_be_one_that_both_have(transport):
    for lock_step in (True, False):
        async with rig(transport, lock_step=lock_step) as made:
            await made.driver.connect()
            with pytest.raises(CyclerProtocolError, match="only in lock-step" if lock_step else "no lock-step"):
                await made.driver.acquire(LIMITS, 1.0, None if lock_step else 0.1)


@every
async def test_nothing_without_control(transport):
    async with rig(transport) as made:
        with pytest.raises(CyclerConnectionError, match="not connected"):
            await made.driver.sample()
        await made.driver.connect()
        for call in (made.driver.apply(1.0), made.driver.output(True)):
            with pytest.raises(CyclerProtocolError, match="acquire first"):
                await call
        assert made.at_rest and not made.device.cycler.remote


@every
async def test_a_trip_is_told_with_its_alarm(transport):
    async with rig(transport) as made:
        await made.acquired(DeviceLimits((2.5, 3.0), (-10.0, 10.0), (-10.0, 60.0), None))
        await made.driver.output(True)
        await made.driver.apply(5.0)
        with pytest.raises(SetPointRefusedError, match=r"tripped \(over_voltage\)") as caught:
            await made.driver.sample()
        assert caught.value.reading.alarms == {"over_voltage"}
        await made.driver.safe()
        await made.driver.clear_fault()
        assert not (await made.driver.sample()).alarms


@every
async def test_missing_values_are_nan_and_not_zero(transport):
    async with rig(transport) as made:
        await made.running()
        nan = math.nan
        made.device.cycler.measurement = made.device.cycler.measurement._replace(
            voltage_V=nan, current_A=nan, temperature_degC=nan, ambient_degC=nan
        )
        if made.transport.startswith("modbus"):
            made.device.publish()
        reading = await made.driver.sample()
        seen = (reading.voltage_V, reading.current_A, reading.temperature_degC, reading.ambient_degC)
        assert all(math.isnan(value) for value in seen)
        assert reading.output_on


@every
async def test_safe_from_a_driver_that_was_never_connected(transport):
    async with rig(transport) as made:
        made.device.cycler.set_remote(True)
        made.device.cycler.set_output(True)
        await made.driver.safe()
        assert made.at_rest


@every
async def test_safe_from_a_second_driver_in_the_middle_of_a_run(transport):
    async with rig(transport) as made:
        await made.running()
        await made.driver.close()
        other = made.another()
        await other.safe()
        assert made.at_rest
        await other.close()


@every
async def test_a_silent_bench_is_switched_off_by_the_device(transport):
    """A hung loop sends nothing: no sender outlives it."""
    clock = HandClock()
    async with rig(transport, lock_step=False, now=clock) as made:
        await made.running(watchdog_s=0.2)
        time.sleep(0.4)  # the whole event loop hangs, the driver's as the simulator's
        clock.time_s += 0.4
        made.device.poll()
        assert made.at_rest and "watchdog" in made.device.cycler.alarms


@every
async def test_another_device_is_left_alone(transport, tmp_path):
    async with rig(transport) as made:
        from drivers.register_map import MAPS

        text = (MAPS / f"{made.map_name}.toml").read_text().replace("equals = 0x4254", "equals = 0x4255")
        text = text.replace('"generic_can.dbc"', f'"{MAPS / "generic_can.dbc"}"')
        path = tmp_path / "other.toml"
        path.write_text(text)
        made.map_name = path
        other = made.another()
        with pytest.raises(CyclerProtocolError, match="another device, or the wrong map"):
            await other.connect()
        with pytest.raises(CyclerError, match="another device"):
            await other.safe()
        await other.close()


async def test_settings_that_somebody_else_has_changed_are_named():
    async with rig("modbus-tcp", lock_step=False) as made:
        await made.running(1.0)
        assert [await made.driver.verify() for _ in range(4)] == [None] * 4
        made.device.cycler.limits["voltage_high"] = 6.0
        made.device.cycler.watchdog_s = 60.0
        made.device.publish()
        told = " ".join(filter(None, [await made.driver.verify() for _ in range(4)]))
        assert "'limit_voltage_high' reads 6 V where 4.25 V was written" in told
        assert "'watchdog' reads 60 s where" in told and "another program" in told
        await made.driver.safe()


@every
async def test_what_is_as_it_was_set_is_said_to_be(transport):
    async with rig(transport, lock_step=False) as made:
        await made.running(1.0)
        assert [await made.driver.verify() for _ in range(4)] == [None] * 4
        await made.driver.safe()


@every
async def test_a_button_that_is_wired_to_the_device_is_told(transport):
    async with rig(transport, lock_step=False) as made:
        assert "stop_input" not in (await made.running(1.0)).status
        made.device.cycler.stop_input = True
        while "stop_input" not in (reading := await made.driver.sample()).status:
            pass
        assert reading.output_on  # the device only tells; the bench stops
        # Between samples too, but on a line where each message takes its time.
        assert await made.driver.stop_input() is (None if transport == "modbus-rtu" else True)
        await made.driver.safe()
