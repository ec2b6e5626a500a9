"""The EA PSB over CAN against a simulator after section 8 of its guide, and the guide's own frames on the bus."""

import asyncio
import math
import uuid

import can
import numpy as np
import pytest

from bench_service.bench.admission import RefusedError, check_start, check_watchdog
from bench_service.bench.limits import Limits
from bench_service.bench.player import make_player
from bench_service.bench.request import RunRequest
from bench_service.bench.settings import BenchSettings
from drivers.cycler import CyclerProtocolError, CyclerTimeoutError, DeviceLimits, SetPointRefusedError
from simulators.bench import SimulatorSettings, build_can_device
from simulators.can_bus import CanAction, CanBusSettings
from simulators.can_node import CanNode
from simulators.cycler import CyclerSettings
from tests.patience import PATIENCE_S
from tests.protocol.rigs import rig

WINDOW = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.0, 1.0), None, 100.0)
LIMITS = DeviceLimits((2.5, 4.25), (-10.0, 10.0), (-10.0, 60.0), None)
# Nominal 60 V and 30 A: 0xCCCC is 30 A.
RATING = CyclerSettings(nominal_voltage_V=60.0, nominal_current_A=30.0, watchdog_s=math.inf)
PSB = {"map_name": "ea_psb_can", "lock_step": False, "cycler": RATING}
both = pytest.mark.parametrize("transport", ["can-virtual", "can-udp"])


def record(made):
    """Note every message that the device gets: register, and the value of a writing one."""
    seen = []
    made.server.on_frame = lambda name, raws: seen.append((int(raws["Register"]), raws.get("Value")))
    return seen


@both
async def test_both_quadrants(transport):
    async with rig(transport, **PSB) as made:
        able = await made.driver.connect()
        assert able.current_A == (-30.0, 30.0) and able.voltage_V == (0.0, 60.0)
        assert able.watchdog_s is None and not able.lock_step and not able.has_sequence
        assert (await made.running(2.0, LIMITS)).output_on
        limits = made.device.cycler.limits
        assert limits["voltage_high"] == pytest.approx(4.25, abs=1e-3)
        assert limits["current_low"] == pytest.approx(-10.0, abs=1e-3)
        for current_A in (5.0, -7.5, -0.1, 0.0, 3.0):
            await made.driver.apply(current_A)
            reading = await made.settled(current_A)
            assert reading.current_A == pytest.approx(current_A, abs=0.02)
            assert reading.voltage_V == pytest.approx(3.7, abs=0.4)
            assert abs(current_A) < 1.0 or ("sink" in reading.status) == (current_A < 0.0)
            assert math.isnan(reading.temperature_degC) and not reading.alarms
        await made.driver.safe()
        assert made.at_rest


async def test_the_voltage_which_turns_the_direction_is_written_last():
    async with rig("can-virtual", **PSB) as made:
        await made.running(5.0, LIMITS)
        seen = record(made)
        await made.driver.apply(-7.5)
        writes = [(register, value) for register, value in seen if value is not None]
        # 7.5 A of 30 A is 0x3333; 2.5 V of 60 V is 52428 * 2.5 / 60 = 2184.5, the nearest even 2184.
        assert writes == [(501, 0), (499, 0x3333), (500, 2184)]
        assert [register for register, _ in seen] == [501, 501, 499, 499, 500, 500], "each is asked for after writing"


async def test_a_sample_asks_for_each_register_alone():
    async with rig("can-virtual", **PSB) as made:
        await made.acquired(LIMITS)
        seen = record(made)
        await made.driver.sample()
        assert sorted(seen) == [(505, None), (507, None), (508, None)]


async def test_a_set_value_beyond_the_adjusted_limit_is_refused_with_the_devices_reason():
    async with rig("can-virtual", **PSB) as made:
        await made.running(2.0, LIMITS)
        with pytest.raises(SetPointRefusedError, match=r"'source_current': Value.*code 3 \(wrong value or length\)"):
            await made.driver.apply(20.0)
        await made.driver.safe()
        assert made.at_rest


async def test_a_refusal_that_the_device_does_not_tell_is_seen_by_reading_back():
    async with rig("can-virtual", **PSB) as made:
        await made.running(2.0, LIMITS)
        made.device.cycler.deaf = True
        with pytest.raises(SetPointRefusedError, match=r"Value was sent as 5243, the device repeats 3495$"):
            await made.driver.apply(3.0)


async def test_without_remote_control_commands_are_refused():
    async with rig("can-virtual", **PSB) as made:
        await made.running(2.0, LIMITS)
        made.device.cycler.set_remote(False)
        with pytest.raises(SetPointRefusedError, match="access denied"):
            await made.driver.apply(3.0)


async def test_a_command_may_be_executed_a_little_later():
    """The guide: write commands are not immediately executed when received."""
    async with rig("can-virtual", **PSB) as made:
        await made.running(2.0, LIMITS)
        cycler, loop = made.device.cycler, asyncio.get_running_loop()
        cycler.deaf = True

        def execute():
            cycler.deaf = False
            cycler.set_current(3.0)

        loop.call_later(0.02, execute)
        await made.driver.apply(3.0)
        assert cycler.requested_A == pytest.approx(3.0, abs=1e-3)


async def test_alarms_and_a_query_that_is_not_answered():
    async with rig("can-virtual", **PSB) as made:
        await made.running(2.0, LIMITS)
        made.device.cycler.trip("over_temperature")
        reading = await made.driver.sample()
        assert reading.alarms == {"alarm"} and not reading.output_on
        made.server.on_frame = lambda name, raws: CanAction(change=lambda _, data: b"\xff\xff\x02")
        with made.impatient(), pytest.raises(CyclerTimeoutError, match="no answer"):
            await made.driver.sample()
        made.server.on_frame = None
        await made.driver.safe()
        await made.driver.clear_fault()
        assert made.at_rest and not made.device.cycler.alarms


async def test_all_known_classes_are_accepted_and_no_other():
    for number, known in ((58, True), (66, True), (83, True), (33, False)):
        async with rig("can-virtual", **PSB) as made:
            answer = number.to_bytes(2, "big")
            made.server.on_frame = lambda name, raws, answer=answer: CanAction(
                change=lambda _, data: data[:2] + answer if data[:2] == b"\0\0" else data
            )
            if known:
                await made.driver.connect()
            else:
                with pytest.raises(CyclerProtocolError, match="reads 33, map 'ea_psb_can' wants 58 or 66 or 83"):
                    await made.driver.connect()


async def test_a_client_that_vanishes_leaves_the_output_on_so_an_interlock_must_be_declared():
    async with rig("can-virtual", **PSB) as made:
        await made.running(2.0, LIMITS)
        able = await made.driver.connect()
        await made.driver.acquire(LIMITS, 1.0, None)
        await made.driver.output(True)
        await made.driver.apply(2.0)
        await made.driver.close()
        made.device.cycler.advance(30.0)
        assert made.device.cycler.output_on
        settings = BenchSettings("b", made.address, "ea_psb_can", WINDOW)
        with pytest.raises(RefusedError, match="has no communication watchdog; set external_interlock = true only if"):
            check_watchdog(settings, able)
        await made.driver.safe()
        assert made.at_rest


async def test_with_an_interlock_it_is_the_missing_temperature_that_stops_a_run_before_it_begins():
    async with rig("can-virtual", **PSB) as made:
        seen = record(made)
        able = await made.driver.connect()
        settings = BenchSettings("b", made.address, "ea_psb_can", WINDOW, external_interlock=True)
        times_s, currents_A = np.array([0.0, 1.0]), np.array([1.0, 0.0])
        request = RunRequest("r", 0.1, WINDOW, 2.5, times_s, currents_A, initial_soc=0.5)
        with pytest.raises(RefusedError, match="measures no temperature of the cell"):
            check_start(settings, able, request, make_player(times_s, currents_A, 0.1))
        assert seen and all(value is None for _, value in seen), "nothing was written"


async def test_the_examples_of_the_guide_on_the_bus():
    """Section 8.3.7, byte by byte: base ID 0x88, nominal 170 A, an upper limit of 30 A at the end."""
    rating = CyclerSettings(nominal_voltage_V=80.0, nominal_current_A=170.0, watchdog_s=math.inf)
    device = build_can_device(SimulatorSettings(map_name="ea_psb_can", cycler=rating))
    channel = uuid.uuid4().hex
    node = CanNode(device, CanBusSettings(interface="virtual", channel=channel, node=0x88))
    await node.start()
    bus = can.Bus(interface="virtual", channel=channel)
    try:

        async def say(identifier, data, wait_s=PATIENCE_S):
            bus.send(can.Message(arbitration_id=identifier, data=bytes.fromhex(data), is_extended_id=False))
            answer = await asyncio.to_thread(bus.recv, wait_s)
            return None if answer is None else (answer.arbitration_id, answer.data.hex())

        assert await say(0x89, "0079") == (0x8A, "007942a00000")
        assert await say(0x88, "0192 01 FF00", 0.2) is None and device.cycler.remote
        assert await say(0x88, "01F5 01 2A2A", 0.2) is None
        assert device.cycler.requested_A == pytest.approx(35.0, abs=0.005)
        assert await say(0x89, "01F5") == (0x8A, "01f52a2a")
        device.cycler.set_limit("current_high", 30.0)
        assert await say(0x88, "01F5 01 2A2A") == (0x8A, "ffff03")
    finally:
        bus.shutdown()
        await node.close()
