"""What the driver sends over Modbus TCP, seen by a proxy between it and the simulated cycler."""

import math
import struct
import subprocess
import sys

import pytest

from drivers.cycler import (
    CyclerConnectionError,
    DeviceLimits,
    SetPointRefusedError,
)
from drivers.factory import open_cycler
from drivers.modbus import ModbusCycler
from drivers.register_map import MAPS
from tests.patience import PATIENCE_S
from tests.protocol.rigs import LIMITS, rig
from tests.protocol.tcp_proxy import SAMPLE


async def test_one_tick_is_one_read_and_one_write(wall):
    await wall.running()
    wall.proxy.requests.clear()
    await wall.driver.sample()
    await wall.driver.apply(2.5)
    read, write = wall.proxy.requests
    assert read == SAMPLE
    assert write[:10] == struct.pack(">BHHBf", 16, 100, 3, 6, 2.5)


async def test_one_tick_in_lock_step_is_one_message(tcp):
    before = await tcp.running()
    tcp.proxy.requests.clear()
    await tcp.driver.apply(2.5)
    after = await tcp.driver.sample()
    (request,) = tcp.proxy.requests
    assert request[:14] == struct.pack(">BHHHHBf", 23, 200, 12, 100, 5, 10, 2.5)
    assert after.sequence == before.sequence + 1 and after.setpoint_in_force_A == 2.5
    await tcp.driver.sample()  # asked for once more, it is read afresh
    assert tcp.proxy.requests[1:] == [SAMPLE]


async def test_a_lock_step_map_without_function_23_reads_and_writes(tmp_path):
    text = (MAPS / "generic.toml").read_text().replace("15, 16, 23]", "15, 16]").replace('"generic"', '"plain"')
    path = tmp_path / "plain.toml"
    path.write_text(text)
    async with rig("modbus-tcp", proxied=True, map_name=str(path)) as tcp:
        await tcp.running()
        assert {request[0] for request in tcp.proxy.requests} == {3, 5, 6, 16}


async def test_only_functions_of_the_map_are_sent(tcp):
    await tcp.running()
    await tcp.driver.safe()
    await tcp.driver.clear_fault()
    await tcp.driver.release()
    assert {request[0] for request in tcp.proxy.requests} <= {3, 5, 6, 16, 23}


async def test_on_the_wall_clock_no_lock_step_register_is_written(wall):
    await wall.running()
    wall.proxy.requests.clear()
    await wall.driver.apply(1.0)
    assert wall.proxy.requests[0][:6] == struct.pack(">BHHB", 16, 100, 3, 6)


@pytest.mark.parametrize("current_A", [math.nan, math.inf, 30.1, -1e9])
async def test_impossible_set_points_are_never_sent(tcp, current_A):
    await tcp.running()
    tcp.proxy.requests.clear()
    with pytest.raises(SetPointRefusedError, match=r"'set_current'.*not sent"):
        await tcp.driver.apply(current_A)
    assert tcp.proxy.requests == []


async def test_impossible_limits_are_refused_before_anything_is_written(tcp):
    await tcp.driver.connect()
    with pytest.raises(SetPointRefusedError, match="'watchdog': 61 s is outside"):
        await tcp.driver.acquire(LIMITS, 61.0, 0.1)
    bad = DeviceLimits((2.5, math.nan), (-1.0, 1.0), (0.0, 40.0), None)
    with pytest.raises(SetPointRefusedError, match="'limit_voltage_high'"):
        await tcp.driver.acquire(bad, 1.0, 0.1)
    assert {request[0] for request in tcp.proxy.requests} == {3}


async def test_acquire_brings_a_running_device_to_rest_first(tcp):
    await tcp.running(3.0)
    await tcp.driver.close()
    await tcp.driver.connect()
    await tcp.driver.acquire(LIMITS, 1.0, 0.1)
    assert tcp.at_rest
    await tcp.driver.output(True)
    await tcp.driver.apply(1.0)
    assert (await tcp.driver.sample()).setpoint_in_force_A == 1.0


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
    async with rig("modbus-tcp", proxied=True, map_name=str(made_up), initial_soc=0.5) as tcp:
        await tcp.acquired(limits)
        cycler = tcp.device.cycler
        assert (cycler.limits["current_low"], cycler.limits["current_high"]) == (-4.0, 9.0)
        assert cycler.ramp_A_per_s == 1000.0
        await tcp.driver.output(True)
        rest = await tcp.driver.sample()
        await tcp.driver.apply(5.0)
        charging = await tcp.driver.sample()
        assert charging.setpoint_in_force_A == 5.0
        assert charging.current_A == pytest.approx(5.0, abs=0.02)
        assert charging.voltage_V > rest.voltage_V
        await tcp.driver.safe()
        assert tcp.at_rest
        functions = [request[0] for request in tcp.proxy.requests]
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
            process.wait(PATIENCE_S)
            with pytest.raises(CyclerConnectionError):
                await driver.sample()
            with pytest.raises(CyclerConnectionError, match="not verified to be at rest"):
                await driver.safe()
            await driver.close()
        finally:
            process.kill()
