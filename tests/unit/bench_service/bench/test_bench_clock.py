import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_service.bench.clock import Grid, LockStepClock, Tick, WallClock


@given(st.lists(st.integers(1, 50), min_size=1, max_size=50))
def test_missed_ticks_are_counted_and_never_played_later(expirations: list[int]) -> None:
    grid, index, missed, played = Grid(10.0, 0.1), -1, 0, 0
    for count in expirations:
        tick = grid.tick(index, count, 10.0 + (index + count) * 0.1 + 0.03)
        assert tick.index > index
        assert tick.lateness_s == pytest.approx(0.03)
        index, missed, played = tick.index, missed + tick.missed, played + 1
    assert played + missed == index + 1


def test_lateness_is_never_negative() -> None:
    assert Grid(10.0, 0.1).tick(-1, 1, 9.999).lateness_s == 0.0


async def test_wall_clock_ticks_on_its_grid() -> None:
    clock = WallClock()
    clock.start(0.02)
    try:
        ticks = [await clock.next_tick() for _ in range(10)]
    finally:
        clock.close()
    assert all(tick is not None for tick in ticks)
    indices = [tick.index for tick in ticks if tick is not None]
    assert indices[0] >= 0 and indices == sorted(set(indices))
    assert indices[-1] + 1 == 10 + sum(tick.missed for tick in ticks if tick is not None)


async def test_wall_clock_skips_what_passed_while_a_tick_was_busy() -> None:
    clock = WallClock()
    loop = asyncio.get_running_loop()
    clock.start(0.01)
    try:
        first = await clock.next_tick()
        busy_until = loop.time() + 0.1
        while loop.time() < busy_until:
            pass
        late = await clock.next_tick()
        following = await clock.next_tick()
    finally:
        clock.close()
    assert first is not None and late is not None and following is not None
    assert late.missed >= 8
    assert following.index > late.index


async def test_interrupt_ends_a_wait_at_once_and_for_good() -> None:
    clock = WallClock()
    clock.start(3600.0)
    try:
        assert await clock.next_tick() is not None
        waiting = asyncio.create_task(clock.next_tick())
        await asyncio.sleep(0)
        clock.interrupt()
        assert await asyncio.wait_for(waiting, 1.0) is None
        assert await clock.next_tick() is None
    finally:
        clock.close()


async def test_lock_step_time_is_exact() -> None:
    clock = LockStepClock()
    clock.start(0.1)
    for k in range(100):
        tick = await clock.next_tick()
        assert tick == Tick(k, 0, 0.0)
        assert clock.sample_time_s(tick, 123.4) == k * 0.1 == clock.elapsed_s(tick)
    clock.interrupt()
    assert await clock.next_tick() is None
