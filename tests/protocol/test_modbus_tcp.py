"""The driver against the simulated cycler over real sockets, with a tampering proxy between them."""

import asyncio
import contextlib
import math
import struct
import subprocess
import sys
import time

import pytest

from drivers.cycler import (
    CyclerConnectionError,
    CyclerError,
    CyclerProtocolError,
    CyclerTimeoutError,
    DeviceLimits,
    SetPointRefusedError,
)
from drivers.factory import open_cycler
from drivers.modbus import ModbusCycler
from drivers.register_map import MAPS
from simulators.bench import SimulatorSettings, build_device
from simulators.modbus_server import ModbusServer

LIMITS = DeviceLimits((2.5, 4.25), (-10.0, 10.0), (-10.0, 60.0), None)
SAMPLE = struct.pack(">BHH", 3, 200, 12)
TIMEOUT_S = 0.25
DROP, CLOSE = "drop", "close"


class Proxy:
    """Passes Modbus TCP on, notes each request, and lets a test change or hold back each reply.

    `on_reply(request, reply)` gets and returns PDUs, or returns `DROP` or `CLOSE`; dropped frames are kept in
    `held`, from where `late` sends them.
    """

    def __init__(self, port):
        self._target = port
        self.requests = []
        self.on_reply = None
        self.held = []
        self._writers = []

    async def start(self):
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        return self._server.sockets[0].getsockname()[1]

    async def stop(self):
        self._server.close()
        for writer in self._writers:
            writer.close()
        await self._server.wait_closed()

    async def late(self):
        """Send what was held back, on the connection it belongs to; False if that is closed."""
        sent = True
        for writer, frame in self.held:
            sent = sent and not writer.is_closing()
            with contextlib.suppress(ConnectionError):
                writer.write(frame)
                await writer.drain()
        return sent

    async def _serve(self, reader, writer):
        self._writers.append(writer)
        up_reader, up_writer = await asyncio.open_connection("127.0.0.1", self._target)
        self._writers.append(up_writer)
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while not writer.is_closing():
                header, request = await self._frame(reader)
                self.requests.append(request)
                up_writer.write(header + request)
                header, reply = await self._frame(up_reader)
                changed = self.on_reply(request, reply) if self.on_reply else reply
                if changed == CLOSE:
                    break
                if changed == DROP:
                    self.held.append((writer, header + reply))
                    continue
                writer.write(header[:4] + struct.pack(">H", len(changed) + 1) + header[6:] + changed)
        up_writer.close()
        writer.close()

    @staticmethod
    async def _frame(reader):
        header = await reader.readexactly(7)
        return header, await reader.readexactly(int.from_bytes(header[4:6], "big") - 1)


class Rig:
    def __init__(self, lock_step=True, map_name="generic", **settings):
        self.lock_step, self.map_name = lock_step, map_name
        self.device = build_device(SimulatorSettings(lock_step=lock_step, map_name=str(map_name), **settings))

    async def __aenter__(self):
        self.server = ModbusServer(self.device)
        self.proxy = Proxy(await self.server.start("127.0.0.1", 0))
        url = f"modbus-tcp://127.0.0.1:{await self.proxy.start()}"
        self.driver = open_cycler(url, self.map_name, TIMEOUT_S)
        return self

    async def __aexit__(self, *_):
        await self.driver.close()
        await self.proxy.stop()
        await self.server.close()

    async def acquired(self, limits=LIMITS, watchdog_s=1.0):
        await self.driver.connect()
        await self.driver.acquire(limits, watchdog_s, 0.1 if self.lock_step else None)

    async def running(self, current_A=2.0):
        """In the middle of a pulse."""
        await self.acquired()
        await self.driver.output(True)
        await self.driver.sample()
        await self.driver.apply(current_A)
        return await self.driver.sample()

    @property
    def at_rest(self):
        return not self.device.cycler.output_on and self.device.cycler.set_point_A == 0.0


@pytest.fixture
async def rig():
    async with Rig() as made:
        yield made


@pytest.fixture
async def wall():
    async with Rig(lock_step=False) as made:
        yield made


def only(wanted, change):
    """Change the replies to requests that start with some bytes."""
    return lambda request, reply: change(reply) if request.startswith(wanted) else reply


def patched(address, *words):
    """Put other registers into the reply to a sample."""
    at = 2 + 2 * (address - 200)
    data = struct.pack(f">{len(words)}H", *words)
    return lambda reply: reply[:at] + data + reply[at + len(data) :]


async def test_a_life_in_lock_step(rig):
    driver = rig.driver
    able = await driver.connect()
    assert (able.current_A, able.voltage_V) == ((-30.0, 30.0), (0.0, 6.0))
    assert able.watchdog_s == (0.1, 60.0)
    assert able.lock_step and able.has_sequence and able.has_device_limits and able.has_ramp
    assert able.serial == "1"
    await driver.acquire(LIMITS, 1.5, 0.1)
    cycler = rig.device.cycler
    assert cycler.remote and rig.at_rest
    assert cycler.watchdog_s == 1.5
    assert cycler.limits["voltage_high"] == 4.25 and cycler.limits["current_low"] == -10.0
    await driver.output(True)
    first = await driver.sample()
    assert first.output_on and not first.alarms
    for k, current_A in enumerate((1.0, -2.5, 0.1), start=1):
        await driver.apply(current_A)
        reading = await driver.sample()
        assert reading.sequence == first.sequence + k
        assert reading.setpoint_in_force_A == pytest.approx(current_A, rel=1e-7)
        assert reading.current_A == pytest.approx(current_A, abs=0.02)
        assert 2.5 < reading.voltage_V < 4.25
        assert reading.temperature_degC == pytest.approx(25, abs=0.5)
    await driver.safe()
    assert rig.at_rest
    await driver.release()
    assert not cycler.remote


async def test_one_tick_is_one_read_and_one_write(wall):
    await wall.running()
    wall.proxy.requests.clear()
    await wall.driver.sample()
    await wall.driver.apply(2.5)
    read, write = wall.proxy.requests
    assert read == SAMPLE
    assert write[:10] == struct.pack(">BHHBf", 16, 100, 3, 6, 2.5)


async def test_one_tick_in_lock_step_is_one_message(rig):
    before = await rig.running()
    rig.proxy.requests.clear()
    await rig.driver.apply(2.5)
    after = await rig.driver.sample()
    (request,) = rig.proxy.requests
    assert request[:14] == struct.pack(">BHHHHBf", 23, 200, 12, 100, 5, 10, 2.5)
    assert after.sequence == before.sequence + 1 and after.setpoint_in_force_A == 2.5
    await rig.driver.sample()  # asked for once more, it is read afresh
    assert rig.proxy.requests[1:] == [SAMPLE]


async def test_a_lock_step_map_without_function_23_reads_and_writes(tmp_path):
    text = (MAPS / "generic.toml").read_text().replace("15, 16, 23]", "15, 16]").replace('"generic"', '"plain"')
    path = tmp_path / "plain.toml"
    path.write_text(text)
    async with Rig(map_name=path) as rig:
        await rig.running()
        assert {request[0] for request in rig.proxy.requests} == {3, 5, 6, 16}


async def test_only_functions_of_the_map_are_sent(rig):
    await rig.running()
    await rig.driver.safe()
    await rig.driver.clear_fault()
    await rig.driver.release()
    assert {request[0] for request in rig.proxy.requests} <= {3, 5, 6, 16, 23}


async def test_on_the_wall_clock_no_lock_step_register_is_written(wall):
    await wall.running()
    wall.proxy.requests.clear()
    await wall.driver.apply(1.0)
    assert wall.proxy.requests[0][:6] == struct.pack(">BHHB", 16, 100, 3, 6)


async def test_the_clock_must_be_one_that_both_have(rig, wall):
    await wall.driver.connect()
    with pytest.raises(CyclerProtocolError, match="no lock-step"):
        await wall.driver.acquire(LIMITS, 1.0, 0.1)
    await rig.driver.connect()
    with pytest.raises(CyclerProtocolError, match="only in lock-step"):
        await rig.driver.acquire(LIMITS, 1.0, None)


@pytest.mark.parametrize("current_A", [math.nan, math.inf, 30.1, -1e9])
async def test_impossible_set_points_are_never_sent(rig, current_A):
    await rig.running()
    rig.proxy.requests.clear()
    with pytest.raises(SetPointRefusedError, match=r"'set_current'.*not sent"):
        await rig.driver.apply(current_A)
    assert rig.proxy.requests == []


async def test_impossible_limits_are_refused_before_anything_is_written(rig):
    await rig.driver.connect()
    with pytest.raises(SetPointRefusedError, match="'watchdog': 61 s is outside"):
        await rig.driver.acquire(LIMITS, 61.0, 0.1)
    bad = DeviceLimits((2.5, math.nan), (-1.0, 1.0), (0.0, 40.0), None)
    with pytest.raises(SetPointRefusedError, match="'limit_voltage_high'"):
        await rig.driver.acquire(bad, 1.0, 0.1)
    assert {request[0] for request in rig.proxy.requests} == {3}


async def test_no_set_point_and_no_output_without_control(rig):
    with pytest.raises(CyclerConnectionError):
        await rig.driver.apply(0.0)
    await rig.driver.connect()
    for call in (rig.driver.apply(1.0), rig.driver.output(True)):
        with pytest.raises(CyclerProtocolError, match="acquire first"):
            await call
    assert {request[0] for request in rig.proxy.requests} == {3}


async def test_a_silent_device_is_a_time_out_and_its_late_answer_meets_nobody(rig):
    before = await rig.running()
    rig.proxy.on_reply = only(SAMPLE, lambda reply: DROP)
    started = time.monotonic()
    with pytest.raises(CyclerTimeoutError, match=r"sequence.*no answer within 0\.25 s"):
        await rig.driver.sample()
    assert time.monotonic() - started < TIMEOUT_S + 0.2
    with pytest.raises(CyclerConnectionError, match="not connected"):
        await rig.driver.sample()
    assert not rig.at_rest
    rig.proxy.on_reply = None
    await rig.driver.safe()
    assert rig.at_rest
    await rig.proxy.late()
    after = await rig.driver.sample()
    assert not after.output_on and before.output_on
    with pytest.raises(CyclerProtocolError, match="acquire first"):  # reconnecting never resumes
        await rig.driver.apply(1.0)


async def test_a_lost_write_is_not_sent_again(rig):
    await rig.running()
    rig.proxy.requests.clear()
    rig.proxy.on_reply = only(b"\x17", lambda reply: DROP)
    with pytest.raises(CyclerTimeoutError, match="'set_current'"):
        await rig.driver.apply(3.0)
    assert [request[0] for request in rig.proxy.requests] == [23]


@pytest.mark.parametrize("count", [0, 2, 11, 13])
async def test_a_reply_of_the_wrong_length_is_refused(rig, count):
    await rig.running()
    rig.proxy.on_reply = only(SAMPLE, lambda _: bytes([3, 2 * count]) + bytes(2 * count))
    with pytest.raises(CyclerProtocolError, match=f"{count} registers came back, 12 were asked for"):
        await rig.driver.sample()


async def test_bytes_that_are_no_modbus_end_the_connection(rig):
    await rig.running()
    rig.proxy.on_reply = only(SAMPLE, lambda reply: reply[:10])
    with pytest.raises(CyclerConnectionError, match="no Modbus"):
        await rig.driver.sample()


async def test_a_reply_to_another_function_is_refused(rig):
    await rig.running()
    rig.proxy.on_reply = only(SAMPLE, lambda reply: b"\x04" + reply[1:])
    with pytest.raises(CyclerProtocolError, match="reply has function 4, request had 3"):
        await rig.driver.sample()


async def test_an_echo_of_another_address_is_refused(wall):
    await wall.running()
    wall.proxy.on_reply = only(b"\x10", lambda reply: reply[:2] + b"\x65" + reply[3:])
    with pytest.raises(CyclerProtocolError, match=r"'set_current'.*the reply repeats"):
        await wall.driver.apply(1.0)


async def test_a_device_exception_names_register_and_reason(rig):
    await rig.running()
    rig.proxy.on_reply = only(b"\x17", lambda _: b"\x97\x07")
    with pytest.raises(CyclerProtocolError, match=r"writing 'set_current'.*exception 7 \(refused"):
        await rig.driver.apply(1.0)


async def test_missing_values_are_nan_and_not_zero(rig):
    await rig.running()
    change = patched(202, 0x7FC0, 0, 0xFF80, 0, 0x8000, 0x8000)
    rig.proxy.on_reply = only(SAMPLE, change)
    reading = await rig.driver.sample()
    missing = (reading.voltage_V, reading.current_A, reading.temperature_degC, reading.ambient_degC)
    assert all(math.isnan(value) for value in missing)
    assert reading.output_on


async def test_a_socket_closed_by_the_device_is_told_at_once(rig):
    await rig.running()
    rig.proxy.on_reply = only(SAMPLE, lambda _: CLOSE)
    started = time.monotonic()
    with pytest.raises(CyclerConnectionError, match="closed by the device"):
        await rig.driver.sample()
    assert time.monotonic() - started < TIMEOUT_S / 2


async def test_another_device_is_left_alone(rig):
    rig.proxy.on_reply = only(struct.pack(">BHH", 3, 0, 1), lambda _: b"\x03\x02\x00\x3a")
    with pytest.raises(CyclerProtocolError, match=r"'device_class' reads 58, map 'generic' wants 16980.*nothing"):
        await rig.driver.connect()
    with pytest.raises(CyclerError, match="wants 16980"):
        await rig.driver.safe()
    assert {request for request in rig.proxy.requests} == {struct.pack(">BHH", 3, 0, 1)}


async def test_constants_that_are_no_numbers(rig):
    rig.proxy.on_reply = only(struct.pack(">BH", 3, 2), lambda _: b"\x03\x04\x7f\xc0\x00\x00")
    with pytest.raises(CyclerProtocolError, match=r"constant i_nom .*reads nan"):
        await rig.driver.connect()


async def test_a_set_point_that_is_not_taken_over_is_seen_in_the_next_sample(rig):
    await rig.running(2.0)
    rig.proxy.on_reply = only(b"\x17", patched(208, 0x4000, 0))
    await rig.driver.apply(3.0)
    with pytest.raises(SetPointRefusedError, match="3 A was written, 2 A is in force") as caught:
        await rig.driver.sample()
    assert caught.value.reading.setpoint_in_force_A == 2.0


async def test_a_set_point_that_is_not_taken_over_is_seen_on_the_wall_clock(wall):
    last = await wall.running(2.0)
    await wall.driver.apply(3.0)
    wall.proxy.on_reply = only(SAMPLE, patched(208, 0x4000, 0))
    with pytest.raises(SetPointRefusedError, match="3 A was written") as caught:
        async with asyncio.timeout(5):
            while True:
                await wall.driver.sample()
    assert caught.value.reading.sequence - last.sequence >= 2


async def test_a_trip_is_told_with_its_alarm(rig):
    await rig.acquired(DeviceLimits((2.5, 3.0), (-10.0, 10.0), (-10.0, 60.0), None))
    await rig.driver.output(True)
    await rig.driver.apply(5.0)
    with pytest.raises(SetPointRefusedError, match=r"tripped \(over_voltage\)") as caught:
        await rig.driver.sample()
    assert caught.value.reading.alarms == {"over_voltage"}
    await rig.driver.safe()
    await rig.driver.clear_fault()
    assert not (await rig.driver.sample()).alarms


async def test_alarms_that_stay_are_told(rig):
    await rig.running()
    rig.proxy.on_reply = only(SAMPLE, patched(211, 0x8008))
    with pytest.raises(CyclerProtocolError, match="alarms stay after clearing: bit_15, over_temperature"):
        await rig.driver.clear_fault()


async def test_a_watchdog_that_does_not_read_back_stops_acquire(rig):
    await rig.driver.connect()
    rig.proxy.on_reply = only(struct.pack(">BHH", 3, 110, 1), lambda _: b"\x03\x02\x75\x30")
    with pytest.raises(SetPointRefusedError, match=r"'watchdog' read back differently: wrote 03E8, reads 7530"):
        await rig.driver.acquire(LIMITS, 1.0, 0.1)
    with pytest.raises(CyclerProtocolError, match="acquire first"):
        await rig.driver.output(True)


async def test_an_output_that_does_not_switch_is_told(rig):
    await rig.acquired()
    rig.proxy.on_reply = only(SAMPLE, patched(210, 0x0002))
    with pytest.raises(CyclerProtocolError, match="output was switched on, but the status says otherwise"):
        await rig.driver.output(True)


async def test_safe_tries_every_step(rig):
    await rig.running()
    rig.server.on_request = lambda frame: None
    rig.proxy.on_reply = only(b"\x10", lambda _: b"\x90\x04")
    with pytest.raises(CyclerProtocolError, match=r"not verified to be at rest.*'set_current'.*device failure"):
        await rig.driver.safe()
    assert rig.at_rest


async def test_safe_from_a_driver_that_was_never_connected(rig):
    rig.device.cycler.set_remote(True)
    rig.device.cycler.set_output(True)
    await rig.driver.safe()
    assert rig.at_rest


async def test_safe_over_a_link_that_breaks_at_each_step(rig):
    await rig.running()
    broken = []

    def break_first_writes(request, reply):
        if request[0] in (5, 16) and request[0] not in broken:
            broken.append(request[0])
            return CLOSE
        return reply

    rig.proxy.on_reply = break_first_writes
    await rig.driver.safe()
    assert broken == [16, 5]
    assert rig.at_rest


async def test_acquire_brings_a_running_device_to_rest_first(rig):
    await rig.running(3.0)
    await rig.driver.close()
    await rig.driver.connect()
    await rig.driver.acquire(LIMITS, 1.0, 0.1)
    assert rig.at_rest
    await rig.driver.output(True)
    await rig.driver.apply(1.0)
    assert (await rig.driver.sample()).setpoint_in_force_A == 1.0


async def test_a_made_up_cycler_is_one_file(tmp_path):
    """Other word order, sign, scale, unit and function codes; the simulator reads the same file."""
    text = (MAPS / "generic.toml").read_text()
    for old, new in (
        ('name = "generic"', 'name = "made_up"'),
        ('word_order = "big"', 'word_order = "little"'),
        ('positive_current = "charge"', 'positive_current = "discharge"'),
        ("unit_id = 1", "unit_id = 7"),
        ("functions = [1, 3, 5, 6, 15, 16, 23]", "functions = [3, 15, 16]"),
        ("min_gap_s = 0.0", "min_gap_s = 0.001"),
        ('address = 102\ntype = "u16"', 'address = 105\ntype = "u16"'),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    made_up = tmp_path / "made_up.toml"
    made_up.write_text(text)
    limits = DeviceLimits((2.5, 4.25), (-4.0, 9.0), (-10.0, 60.0), 1000.0)
    async with Rig(map_name=made_up, initial_soc=0.5) as rig:
        await rig.acquired(limits)
        cycler = rig.device.cycler
        assert (cycler.limits["current_low"], cycler.limits["current_high"]) == (-4.0, 9.0)
        assert cycler.ramp_A_per_s == 1000.0
        await rig.driver.output(True)
        rest = await rig.driver.sample()
        await rig.driver.apply(5.0)
        charging = await rig.driver.sample()
        assert charging.setpoint_in_force_A == 5.0
        assert charging.current_A == pytest.approx(5.0, abs=0.02)
        assert charging.voltage_V > rest.voltage_V
        await rig.driver.safe()
        assert rig.at_rest
        functions = [request[0] for request in rig.proxy.requests]
        assert set(functions) <= {3, 15, 16}


async def test_nobody_at_the_address(unused_tcp_port):
    driver = open_cycler(f"modbus-tcp://127.0.0.1:{unused_tcp_port}", "generic", 0.1)
    for call in (driver.connect, driver.safe):
        with pytest.raises(CyclerConnectionError, match="cannot connect"):
            await call()
    await driver.close()


@pytest.mark.parametrize(
    "url",
    ["127.0.0.1:502", "modbus-tcp://", "modbus-tcp://h:99999", "modbus-tcp://h:1/x"],
)
def test_addresses_that_cannot_be_understood(url):
    with pytest.raises(CyclerConnectionError, match="modbus-tcp://HOST:PORT|Port out of range"):
        open_cycler(url, "generic", 0.1)


def test_the_default_port_and_the_time_out():
    assert isinstance(open_cycler("modbus-tcp://cycler.lab", "generic", 0.1), ModbusCycler)
    with pytest.raises(CyclerConnectionError, match="must be positive"):
        open_cycler("modbus-tcp://cycler.lab", "generic", 0.0)


SIMULATOR = """
import asyncio
from simulators.bench import SimulatorSettings, serve
asyncio.run(serve(SimulatorSettings(lock_step=True), lambda address: print(address, flush=True)))
"""


async def test_between_two_processes_until_one_is_killed():
    with subprocess.Popen([sys.executable, "-c", SIMULATOR], stdout=subprocess.PIPE, text=True) as process:
        try:
            url = process.stdout.readline().strip()
            driver = open_cycler(url, "generic", 1.0)
            await driver.connect()
            await driver.acquire(LIMITS, 1.0, 1.0)
            await driver.output(True)
            first = await driver.sample()
            for k in range(500):
                await driver.apply(1.0 if k % 2 else -1.0)
                reading = await driver.sample()
            assert reading.sequence == first.sequence + 500
            process.kill()
            process.wait(10)
            with pytest.raises(CyclerConnectionError):
                await driver.sample()
            with pytest.raises(CyclerConnectionError, match="not verified to be at rest"):
                await driver.safe()
            await driver.close()
        finally:
            process.kill()
