"""What the simulated cycler does as time passes: lock-step, watchdog, limits; with frames written by hand."""

import math
import struct

import pytest

from tests.protocol.raw_modbus import COMMAND_OK, READ_ALL, rig, switch_on


async def test_lock_step_moves_only_by_ticks() -> None:
    async with rig() as r:
        c = r.client
        assert await c.ask("03 006F 0001") == bytes.fromhex("03 02 0001")
        assert await c.ask("10 0070 0002 04 000F4240") == bytes.fromhex("10 0070 0002")  # 1 s
        await switch_on(c)
        start = await c.sample()
        r.clock.time_s += 1.5
        assert await c.sample() == start
        assert await c.command(2.0, tick=1) == bytes.fromhex(COMMAND_OK)
        one = await c.sample()
        assert (one["sequence"], one["setpoint_A"], one["alarms"]) == (1, 2.0, 0)
        assert one["current_A"] == pytest.approx(2.0, abs=0.01)
        assert one["voltage_V"] > start["voltage_V"] + 0.03
        assert one["status"] == 0b10011
        assert await c.command(2.0, tick=1) == bytes.fromhex(COMMAND_OK)  # a repeat moves nothing
        assert await c.sample() == one
        await c.ask("10 0070 0002 04 000F4240")  # a new period starts the count again
        assert await c.command(2.0, tick=1) == bytes.fromhex(COMMAND_OK)
        assert (await c.sample())["sequence"] == 2


async def play(seed: int) -> list[bytes]:
    async with rig(seed=seed) as r:
        await switch_on(r.client)
        record = []
        for tick in range(1, 200):
            await r.client.command(math.sin(tick) * 5.0, tick=tick, beat=tick)
            r.clock.time_s += 0.001 * (tick % 7)  # the wall clock must not matter
            record.append(await r.client.ask(READ_ALL))
        return record


async def test_lock_step_is_reproducible_to_the_bit() -> None:
    first = await play(5)
    assert await play(5) == first
    assert await play(6) != first


async def test_client_gone_in_lock_step() -> None:
    async with rig() as r:
        await switch_on(r.client)
        await r.client.command(2.0, tick=1)
        r.clock.time_s += 1.9
        assert (await r.client.sample())["alarms"] == 0
        r.clock.time_s += 2.1
        late = await r.client.sample()
        assert late["alarms"] == 1 << 6
        assert not await r.client.output_on()
        assert late["setpoint_A"] == 0.0
        assert await r.client.ask("05 0001 FF00") == bytes.fromhex("85 04")  # latched
        assert await r.client.ask("05 0002 FF00") == bytes.fromhex("05 0002 FF00")
        assert await r.client.ask("05 0001 FF00") == bytes.fromhex("05 0001 FF00")


async def test_watchdog_on_the_wall_clock() -> None:
    async with rig(lock_step=False) as r:
        c = r.client
        await switch_on(c)
        await c.ask("06 006E 01F4")  # 0.5 s
        assert await c.command(2.0, tick=0) == bytes.fromhex(COMMAND_OK)
        for _ in range(5):
            r.clock.time_s += 0.4
            assert await c.output_on()
            await c.ask("06 0066 0001")  # heartbeat alone
        r.clock.time_s += 0.4
        assert (await c.sample())["current_A"] == pytest.approx(2.0, abs=0.01)
        r.clock.time_s += 0.2  # reading alone is no heartbeat
        tripped = await c.sample()
        assert tripped["alarms"] == 1 << 5
        assert tripped["status"] == 0b110
        assert tripped["current_A"] == pytest.approx(0.0, abs=0.01)
        assert await c.command(0.0, tick=1) == bytes.fromhex("90 03")  # no lock-step here


async def test_watchdog_counts_wall_time_at_any_speed() -> None:
    async with rig(lock_step=False, speed=20.0) as r:
        await switch_on(r.client)
        await r.client.ask("06 006E 03E8")  # 1 s
        r.clock.time_s += 0.98
        assert (await r.client.sample())["alarms"] == 0
        await r.client.ask("06 0066 0001")  # heartbeat
        r.clock.time_s += 0.98
        assert (await r.client.sample())["alarms"] == 0
        r.clock.time_s += 0.03
        assert (await r.client.sample())["alarms"] == 1 << 5


async def test_sequence_counts_measurements_on_the_wall_clock() -> None:
    async with rig(lock_step=False) as r:
        first = await r.client.sample()
        assert await r.client.sample() == first
        r.clock.time_s += 0.01
        assert (await r.client.sample())["sequence"] == pytest.approx(first["sequence"] + 10, abs=1)


async def test_device_limit_trips_the_output() -> None:
    async with rig() as r:
        await switch_on(r.client)
        await r.client.ask(struct.pack(">BHHBf", 16, 120, 2, 4, 3.72))
        await r.client.command(3.0, tick=1)
        tripped = await r.client.sample()
        assert tripped["alarms"] == 1
        assert not await r.client.output_on()
        assert tripped["setpoint_A"] == 0.0


async def test_giving_up_remote_switches_off() -> None:
    async with rig() as r:
        await switch_on(r.client)
        await r.client.command(1.0, tick=1)
        await r.client.ask("05 0000 0000")
        assert await r.client.ask("01 0000 0003") == bytes.fromhex("01 01 00")
        assert (await r.client.sample())["setpoint_A"] == 0.0
