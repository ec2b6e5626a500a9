"""Maps of real devices against simulators that behave like them in what matters: EA, Riden, Mean Well."""

import math
import struct

import pytest

from bench_service.bench.admission import RefusedError, check_watchdog
from bench_service.bench.limits import Limits
from bench_service.bench.settings import BenchSettings
from drivers.cycler import CyclerProtocolError, CyclerTimeoutError, DeviceLimits, SetPointRefusedError
from drivers.factory import open_cycler
from drivers.register_map import list_maps, load_can_map, load_map, map_transport
from simulators.can_bus import CanAction
from simulators.cycler import CyclerSettings
from simulators.modbus_actions import Action
from tests.protocol.rigs import TIMEOUT_S, rig

LIMITS = DeviceLimits((2.5, 4.25), (-10.0, 10.0), (-10.0, 60.0), None)
# Nominal 60 V and 30 A: 0xCCCC is 30 A.
PSB = {"map_name": "ea_psb", "lock_step": False, "cycler": CyclerSettings(
    nominal_voltage_V=60.0, nominal_current_A=30.0, watchdog_s=math.inf)}  # fmt: skip
SUPPLY = {"map_name": "riden_rd6006", "lock_step": False}
wires = pytest.mark.parametrize("transport", ["modbus-tcp", "modbus-rtu"])


def record(made):
    """Note every request that the device gets."""
    seen = []
    made.server.on_request = lambda frame: seen.append(frame.pdu)
    return seen


@wires
async def test_a_bidirectional_supply_in_both_quadrants(transport):
    async with rig(transport, **PSB) as made:
        able = await made.driver.connect()
        assert able.current_A == (-30.0, 30.0) and able.voltage_V == (0.0, 60.0)
        assert able.watchdog_s is None and not able.lock_step and not able.has_sequence
        assert (await made.running(2.0, LIMITS)).output_on
        for current_A in (5.0, -7.5, -0.1, 0.0, 3.0):
            await made.driver.apply(current_A)
            reading = await made.driver.sample()
            assert reading.current_A == pytest.approx(current_A, abs=0.01)
            assert reading.voltage_V == pytest.approx(3.7, abs=0.4)
            assert current_A == 0.0 or ("sink" in reading.status) == (current_A < 0.0)
            assert math.isnan(reading.temperature_degC) and not reading.alarms
        await made.driver.safe()
        assert made.at_rest


async def test_the_other_quadrant_goes_to_zero_first_and_each_register_alone():
    async with rig("modbus-tcp", **PSB) as made:
        await made.running(5.0, LIMITS)
        seen = record(made)
        await made.driver.apply(-7.5)
        writes = [struct.unpack(">BHH", pdu) for pdu in seen if pdu[0] == 6]
        # 7.5 A of 30 A is 0x3333; 2.5 V of 60 V is 52428 * 2.5 / 60 = 2184.5, the nearest even 2184.
        assert writes == [(6, 501, 0), (6, 500, 2184), (6, 499, 0x3333)]
        assert {pdu[0] for pdu in seen} == {3, 6}
        with pytest.raises(CyclerProtocolError, match="exception 3"):
            await made.driver._link.write_registers(499, [1, 2], "two set values at once")


async def test_reads_do_not_cross_types():
    async with rig("modbus-tcp", **PSB) as made:
        await made.acquired(LIMITS)
        seen = record(made)
        await made.driver.sample()
        assert seen == [bytes.fromhex("03 01F9 0002"), bytes.fromhex("03 01FB 0002")]
        with pytest.raises(CyclerProtocolError, match="exception 3"):
            await made.driver._link.read_registers("holding", 505, 4, "status and actual values")


async def test_a_set_value_beyond_the_adjusted_limit_is_seen_by_reading_it_back():
    async with rig("modbus-tcp", **PSB) as made:
        await made.running(2.0, LIMITS)
        with pytest.raises(SetPointRefusedError, match=r"'set_source_current' read back differently"):
            await made.driver.apply(20.0)


async def test_without_remote_control_commands_are_refused():
    async with rig("modbus-tcp", **PSB) as made:
        await made.running(2.0, LIMITS)
        made.device.cycler.set_remote(False)
        with pytest.raises(CyclerProtocolError, match=r"exception 7 \(refused by the device \(not in remote control"):
            await made.driver.apply(3.0)


async def test_a_client_that_vanishes_leaves_the_output_on_so_an_interlock_must_be_declared():
    async with rig("modbus-tcp", **PSB) as made:
        await made.running(2.0, LIMITS)
        able = await made.driver.connect()
        await made.driver.acquire(LIMITS, 1.0, None)
        await made.driver.output(True)
        await made.driver.apply(2.0)
        await made.driver.close()
        made.device.cycler.advance(30.0)
        assert made.device.cycler.output_on
        window = Limits((2.5, 4.2), (-5.0, 5.0), (0.0, 45.0), (0.0, 1.0), None, 100.0)
        settings = BenchSettings("b", made.address, "ea_psb", window)
        with pytest.raises(RefusedError, match=r"has no communication watchdog; set external_interlock = true only if"):
            check_watchdog(settings, able)
        await made.driver.safe()
        assert made.at_rest


async def test_all_known_classes_are_accepted_and_no_other():
    for number, known in ((58, True), (66, True), (83, True), (33, False)):
        async with rig("modbus-tcp", **PSB) as made:
            made.device.image._spaces["holding"][0:2] = struct.pack(">H", number)
            if known:
                await made.driver.connect()
            else:
                with pytest.raises(CyclerProtocolError, match="reads 33, map 'ea_psb' wants 58 or 66 or 83"):
                    await made.driver.connect()


@wires
async def test_a_supply_that_only_charges(transport):
    async with rig(transport, **SUPPLY) as made:
        able = await made.driver.connect()
        assert able.current_A == (0.0, 6.0) and able.serial == "1"
        assert (await made.running(2.0, DeviceLimits((2.5, 4.2), (0.0, 5.0), (0.0, 45.0), None))).output_on
        reading = await made.driver.sample()
        assert reading.current_A == pytest.approx(2.0, abs=0.01) and reading.temperature_degC == 25.0
        with pytest.raises(SetPointRefusedError, match=r"-1 A is outside -?0 \.\. 6 A; not sent"):
            await made.driver.apply(-1.0)
        await made.driver.safe()
        assert made.at_rest


async def test_a_probe_below_zero_is_no_temperature_above_zero():
    async with rig("modbus-tcp", **SUPPLY) as made:
        await made.driver.connect()
        minus_20 = bytes.fromhex("03 04 0001 0014")
        made.server.on_request = lambda frame: Action(
            change=lambda request, answer: minus_20 if request[:3] == bytes.fromhex("03 0022") else answer
        )
        assert (await made.driver.sample()).temperature_degC > 60_000


BATTERY_SUPPLY = {"map_name": "meanwell_bic2200_24", "lock_step": False}


async def test_answers_under_one_identifier_are_told_apart_by_their_content():
    async with rig("can-virtual", **BATTERY_SUPPLY) as made:
        await made.running(5.0, LIMITS)
        await made.driver.apply(-7.5)
        assert (made.device.cycler.limits["voltage_high"], made.device.cycler.limits["voltage_low"]) == (4.25, 2.5)
        reading = await made.driver.sample()
        assert reading.status == {"output_on", "discharging"}
        # The device repeats an answer to something else: none of the questions is answered.
        made.server.on_frame = lambda name, raws: CanAction(change=lambda _, data: b"\x50\x00" + data[2:])
        with made.impatient(), pytest.raises(CyclerTimeoutError, match="no answer"):
            await made.driver.sample()
        made.server.on_frame = None
        await made.driver.safe()
        assert made.at_rest


async def test_faults_are_bits_of_a_number():
    async with rig("can-virtual", **BATTERY_SUPPLY) as made:
        await made.running(5.0, LIMITS)
        made.device.cycler.alarms |= {"over_current", "over_temperature"}
        assert (await made.driver.sample()).alarms == {"over_current", "temperature"}


async def test_a_set_value_that_is_not_taken_is_seen_by_asking_for_it():
    async with rig("can-virtual", **BATTERY_SUPPLY) as made:
        await made.running(5.0, LIMITS)
        made.device.cycler.deaf = True
        with pytest.raises(SetPointRefusedError, match="'charge_current': Value was sent as 6, the device repeats 5"):
            await made.driver.apply(6.0)


def test_nothing_here_has_run_on_hardware():
    real = [name for name in list_maps() if not name.startswith("generic")]
    assert len(real) == 5
    for name in real:
        found = load_can_map(name) if map_transport(name) == "can" else load_map(name)
        assert not found.verified_on_hardware and "not yet run on hardware" in found.source
    assert open_cycler("modbus-rtu:///dev/x?unit=1", "ea_psb", TIMEOUT_S)
