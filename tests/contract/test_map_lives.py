"""Every map that comes with the program, over every transport it can have, against the simulator it gets."""

import math

import pytest

from drivers.cycler import (
    CyclerConnectionError,
    CyclerProtocolError,
    CyclerTimeoutError,
    DeviceLimits,
    SetPointRefusedError,
)
from drivers.register_map import list_maps, map_transport
from simulators.can_bus import CanAction
from simulators.modbus_actions import SILENCE
from tests.protocol.rigs import rig

LIMITS = DeviceLimits((2.5, 4.2), (-4.0, 4.0), (0.0, 60.0), None)
WITHOUT_TEMPERATURE = ("ea_psb", "ea_psb_can", "meanwell_bic2200_24")
CASES = [
    (name, transport)
    for name in list_maps()
    for transport in (("can-virtual", "can-udp") if map_transport(name) == "can" else ("modbus-tcp", "modbus-rtu"))
]


@pytest.mark.parametrize(("name", "transport"), CASES)
async def test_a_whole_life(name, transport):
    async with rig(transport, lock_step=False, map_name=name) as made:
        driver, cycler = made.driver, made.device.cycler
        able = await driver.connect()
        low_A, high_A = able.current_A
        assert able.has_temperature == (name not in WITHOUT_TEMPERATURE)
        limits = DeviceLimits(LIMITS.voltage_V, (max(low_A, -4.0), min(high_A, 4.0)), LIMITS.temperature_degC, None)
        await driver.acquire(limits, 1.0, None)
        assert made.at_rest
        await driver.output(True)
        for current_A in (1.0, max(low_A, -2.0), 0.0, 2.0):
            await driver.apply(current_A)
            reading = await made.settled(current_A)
            assert reading.output_on and not reading.alarms
            assert reading.current_A == pytest.approx(current_A, abs=0.02)
            assert 3.0 < reading.voltage_V < 4.2
            assert cycler.set_point_A == pytest.approx(current_A, abs=1e-3)
        for impossible_A in (math.nan, math.inf, 2.0 * high_A):
            with pytest.raises(SetPointRefusedError, match="not sent"):
                await driver.apply(impossible_A)
        assert cycler.set_point_A == pytest.approx(2.0, abs=1e-3)
        await driver.output(False)
        assert made.at_rest and not (await driver.sample()).output_on
        await driver.safe()
        await driver.clear_fault()
        await driver.release()
        await driver.close()
        await driver.safe()  # from a closed link too
        assert made.at_rest


@pytest.mark.parametrize(("name", "transport"), CASES)
async def test_a_device_that_falls_silent_in_a_pulse(name, transport):
    async with rig(transport, lock_step=False, map_name=name, timeout_s=0.1) as made:
        limits = DeviceLimits(LIMITS.voltage_V, (-4.0, 4.0), LIMITS.temperature_degC, None)
        await made.running(2.0, limits)
        if transport.startswith("can"):
            made.server.on_frame = lambda message, raws: CanAction(execute=False)
        else:
            made.server.on_request = lambda frame: SILENCE
        with made.impatient(), pytest.raises(CyclerTimeoutError, match=r"no answer.*within 0\.1 s"):
            await made.driver.sample()
        made.server.on_frame = made.server.on_request = None
        with pytest.raises(CyclerConnectionError, match="not connected"):  # nothing resumes by itself
            await made.driver.sample()
        await made.driver.safe()
        assert made.at_rest
        with pytest.raises(CyclerProtocolError, match="acquire first"):
            await made.driver.apply(1.0)
