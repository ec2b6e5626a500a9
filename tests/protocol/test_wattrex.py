"""The WattRex map against a simulator that behaves like it: shared identifiers, old echoes, a heartbeat off at boot."""

import math

import pytest

from drivers.cycler import CyclerProtocolError, DeviceLimits, SetPointRefusedError
from tests.protocol.raw_modbus import HandClock
from tests.protocol.rigs import rig

LIMITS = DeviceLimits((2.5, 4.25), (-10.0, 10.0), (-10.0, 60.0), None)
both = pytest.mark.parametrize("transport", ["can-virtual", "can-udp"])


@both
async def test_a_life(transport):
    async with rig(transport, lock_step=False, map_name="wattrex_epc") as made:
        able = await made.driver.connect()
        assert able.current_A == (-15.5, 15.5) and able.voltage_V == (0.4, 5.1) and able.serial == "1"
        assert able.watchdog_s is None, "a heartbeat that cannot be read back is no watchdog"
        before = await made.running(-2.5, LIMITS)
        assert before.output_on and before.setpoint_in_force_A == -2.5
        limits = made.device.cycler.limits
        assert (limits["voltage_high"], limits["current_low"], limits["temperature_high"]) == (4.25, -10.0, 60.0)
        for current_A in (1.0, -3.0, 0.0):
            await made.driver.apply(current_A)
            reading = await made.driver.sample()
            assert reading.setpoint_in_force_A == current_A
        assert made.device.commands.voltage_limit_V == 4.25
        await made.driver.safe()
        assert made.at_rest and not (await made.driver.sample()).output_on


@both
async def test_a_refused_set_point_echoes_the_old_one(transport):
    async with rig(transport, lock_step=False, map_name="wattrex_epc") as made:
        await made.running(2.0, LIMITS)
        with pytest.raises(SetPointRefusedError, match="Reference was sent as 12, the device repeats 2"):
            await made.driver.apply(12.0)  # within the device, beyond the limits told to it


@both
async def test_another_node_is_noticed(transport):
    async with rig(transport, lock_step=False, map_name="wattrex_epc") as made:
        made.device.node = 5
        with pytest.raises(CyclerProtocolError, match=r"'Info.Device' reads 5, map 'wattrex_epc' wants 0"):
            await made.driver.connect()


async def test_the_heartbeat_keeps_the_output_on_and_its_end_switches_it_off():
    clock = HandClock()
    async with rig("can-virtual", lock_step=False, map_name="wattrex_epc", now=clock) as made:
        assert made.device.cycler.watchdog_s == math.inf
        await made.running(2.0, LIMITS, watchdog_s=0.3)
        for _ in range(6):
            clock.time_s += 0.1
            await made.driver.apply(2.0)
        assert (await made.driver.sample()).output_on
        clock.time_s += 0.4
        made.device.poll()
        assert made.at_rest
        with pytest.raises(SetPointRefusedError, match="communication"):
            await made.driver.sample()
