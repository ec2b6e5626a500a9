"""Replies that are wrong, late or missing: a proxy tampers with them between driver and simulated cycler."""

import asyncio
import math
import struct
import time

import pytest

from drivers.cycler import (
    CyclerConnectionError,
    CyclerError,
    CyclerProtocolError,
    CyclerTimeoutError,
    SetPointRefusedError,
)
from tests.patience import PATIENCE_S
from tests.protocol.rigs import LIMITS, PATIENT_S, TIMEOUT_S
from tests.protocol.tcp_proxy import CLOSE, DROP, SAMPLE, only, patched


async def test_a_silent_device_is_a_time_out_and_its_late_answer_meets_nobody(tcp):
    before = await tcp.running()
    tcp.proxy.on_reply = only(SAMPLE, lambda reply: DROP)
    started = time.monotonic()
    with tcp.impatient(), pytest.raises(CyclerTimeoutError, match=r"sequence.*no answer within 0\.25 s"):
        await tcp.driver.sample()
    assert TIMEOUT_S <= time.monotonic() - started < PATIENT_S / 2
    with pytest.raises(CyclerConnectionError, match="not connected"):
        await tcp.driver.sample()
    assert not tcp.at_rest
    tcp.proxy.on_reply = None
    await tcp.driver.safe()
    assert tcp.at_rest
    await tcp.proxy.late()
    after = await tcp.driver.sample()
    assert not after.output_on and before.output_on
    with pytest.raises(CyclerProtocolError, match="acquire first"):  # reconnecting never resumes
        await tcp.driver.apply(1.0)


async def test_a_lost_write_is_not_sent_again(tcp):
    await tcp.running()
    tcp.proxy.requests.clear()
    tcp.proxy.on_reply = only(b"\x17", lambda reply: DROP)
    with tcp.impatient(), pytest.raises(CyclerTimeoutError, match="'set_current'"):
        await tcp.driver.apply(3.0)
    assert [request[0] for request in tcp.proxy.requests] == [23]


@pytest.mark.parametrize("count", [0, 2, 11, 13])
async def test_a_reply_of_the_wrong_length_is_refused(tcp, count):
    await tcp.running()
    tcp.proxy.on_reply = only(SAMPLE, lambda _: bytes([3, 2 * count]) + bytes(2 * count))
    with pytest.raises(CyclerProtocolError, match=f"{count} registers came back, 12 were asked for"):
        await tcp.driver.sample()


async def test_bytes_that_are_no_modbus_end_the_connection(tcp):
    await tcp.running()
    tcp.proxy.on_reply = only(SAMPLE, lambda reply: reply[:10])
    with pytest.raises(CyclerConnectionError, match="no Modbus"):
        await tcp.driver.sample()


async def test_a_reply_to_another_function_is_refused(tcp):
    await tcp.running()
    tcp.proxy.on_reply = only(SAMPLE, lambda reply: b"\x04" + reply[1:])
    with pytest.raises(CyclerProtocolError, match="reply has function 4, request had 3"):
        await tcp.driver.sample()


async def test_an_echo_of_another_address_is_refused(wall):
    await wall.running()
    wall.proxy.on_reply = only(b"\x10", lambda reply: reply[:2] + b"\x65" + reply[3:])
    with pytest.raises(CyclerProtocolError, match=r"'set_current'.*the reply repeats"):
        await wall.driver.apply(1.0)


async def test_a_device_exception_names_register_and_reason(tcp):
    await tcp.running()
    tcp.proxy.on_reply = only(b"\x17", lambda _: b"\x97\x07")
    with pytest.raises(CyclerProtocolError, match=r"writing 'set_current'.*exception 7 \(refused"):
        await tcp.driver.apply(1.0)


async def test_missing_values_are_nan_and_not_zero(tcp):
    await tcp.running()
    change = patched(202, 0x7FC0, 0, 0xFF80, 0, 0x8000, 0x8000)
    tcp.proxy.on_reply = only(SAMPLE, change)
    reading = await tcp.driver.sample()
    missing = (reading.voltage_V, reading.current_A, reading.temperature_degC, reading.ambient_degC)
    assert all(math.isnan(value) for value in missing)
    assert reading.output_on


async def test_a_socket_closed_by_the_device_is_told_at_once(tcp):
    await tcp.running()
    tcp.proxy.on_reply = only(SAMPLE, lambda _: CLOSE)
    started = time.monotonic()
    with pytest.raises(CyclerConnectionError, match="closed by the device"):
        await tcp.driver.sample()
    assert time.monotonic() - started < PATIENT_S / 2, "it waited for an answer that cannot come"


async def test_another_device_is_left_alone(tcp):
    tcp.proxy.on_reply = only(struct.pack(">BHH", 3, 0, 1), lambda _: b"\x03\x02\x00\x3a")
    with pytest.raises(CyclerProtocolError, match=r"'device_class' reads 58, map 'generic' wants 16980.*nothing"):
        await tcp.driver.connect()
    with pytest.raises(CyclerError, match="wants 16980"):
        await tcp.driver.safe()
    assert {request for request in tcp.proxy.requests} == {struct.pack(">BHH", 3, 0, 1)}


async def test_constants_that_are_no_numbers(tcp):
    tcp.proxy.on_reply = only(struct.pack(">BH", 3, 2), lambda _: b"\x03\x04\x7f\xc0\x00\x00")
    with pytest.raises(CyclerProtocolError, match=r"constant i_nom .*reads nan"):
        await tcp.driver.connect()


async def test_a_set_point_that_is_not_taken_over_is_seen_in_the_next_sample(tcp):
    await tcp.running(2.0)
    tcp.proxy.on_reply = only(b"\x17", patched(208, 0x4000, 0))
    await tcp.driver.apply(3.0)
    with pytest.raises(SetPointRefusedError, match="3 A was written, 2 A is in force") as caught:
        await tcp.driver.sample()
    assert caught.value.reading.setpoint_in_force_A == 2.0


async def test_a_set_point_that_is_not_taken_over_is_seen_on_the_wall_clock(wall):
    last = await wall.running(2.0)
    await wall.driver.apply(3.0)
    wall.proxy.on_reply = only(SAMPLE, patched(208, 0x4000, 0))
    with pytest.raises(SetPointRefusedError, match="3 A was written") as caught:
        async with asyncio.timeout(PATIENCE_S):
            while True:
                await wall.driver.sample()
    assert caught.value.reading.sequence - last.sequence >= 2


async def test_alarms_that_stay_are_told(tcp):
    await tcp.running()
    tcp.proxy.on_reply = only(SAMPLE, patched(211, 0x8008))
    with pytest.raises(CyclerProtocolError, match="alarms stay after clearing: bit_15, over_temperature"):
        await tcp.driver.clear_fault()


async def test_a_watchdog_that_does_not_read_back_stops_acquire(tcp):
    await tcp.driver.connect()
    tcp.proxy.on_reply = only(struct.pack(">BHH", 3, 110, 1), lambda _: b"\x03\x02\x75\x30")
    with pytest.raises(SetPointRefusedError, match=r"'watchdog' read back differently: wrote 03E8, reads 7530"):
        await tcp.driver.acquire(LIMITS, 1.0, 0.1)
    with pytest.raises(CyclerProtocolError, match="acquire first"):
        await tcp.driver.output(True)


async def test_an_output_that_does_not_switch_is_told(tcp):
    await tcp.acquired()
    tcp.proxy.on_reply = only(SAMPLE, patched(210, 0x0002))
    with pytest.raises(CyclerProtocolError, match="output was switched on, but the status says otherwise"):
        await tcp.driver.output(True)


async def test_safe_tries_every_step(tcp):
    await tcp.running()
    tcp.server.on_request = lambda frame: None
    tcp.proxy.on_reply = only(b"\x10", lambda _: b"\x90\x04")
    with pytest.raises(CyclerProtocolError, match=r"not verified to be at rest.*'set_current'.*device failure"):
        await tcp.driver.safe()
    assert tcp.at_rest


async def test_safe_over_a_link_that_breaks_at_each_step(tcp):
    await tcp.running()
    broken = []

    def break_first_writes(request, reply):
        if request[0] in (5, 16) and request[0] not in broken:
            broken.append(request[0])
            return CLOSE
        return reply

    tcp.proxy.on_reply = break_first_writes
    await tcp.driver.safe()
    assert broken == [16, 5]
    assert tcp.at_rest
