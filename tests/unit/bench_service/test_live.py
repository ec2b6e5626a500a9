"""No reader of the live feed can hold up or fill the service."""

import asyncio

import pytest

from bench_service.campaign.live import Broadcaster, TooManyReadersError
from tests.patience import PATIENCE_S


async def test_a_slow_reader_loses_the_oldest_messages() -> None:
    feed = Broadcaster(depth=3)
    slow, quick = feed.subscribe(), feed.subscribe()
    for k in range(5):
        feed.publish({"k": k})
        assert await quick.get() == {"k": k}
    assert [(await slow.get())["k"] for _ in range(3)] == [2, 3, 4]
    assert (slow.dropped, quick.dropped) == (2, 0)


async def test_a_waiting_reader_is_woken() -> None:
    feed = Broadcaster()
    reader = feed.subscribe()
    waiting = asyncio.create_task(reader.get())
    await asyncio.sleep(0)
    assert not waiting.done()
    feed.publish({"type": "x"})
    assert await asyncio.wait_for(waiting, PATIENCE_S) == {"type": "x"}


async def test_readers_are_capped_and_make_room() -> None:
    feed = Broadcaster(max_readers=2)
    first, _ = feed.subscribe(), feed.subscribe()
    with pytest.raises(TooManyReadersError, match="2 readers"):
        feed.subscribe()
    feed.unsubscribe(first)
    feed.unsubscribe(first)
    feed.subscribe()
    feed.publish({"k": 1})
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(first.get(), 0.05)


async def test_of_a_benchs_values_a_paced_reader_gets_the_newest() -> None:
    feed = Broadcaster()
    reader = feed.subscribe(every_s=0.01)
    for k in range(5):
        feed.publish({"type": "live", "bench": "a", "k": k})
        feed.publish({"type": "live", "bench": "b", "k": 10 * k})
    feed.publish({"type": "event", "k": -1})
    assert (await reader.get())["k"] == -1, "what happens does not wait"
    got = [await asyncio.wait_for(reader.get(), PATIENCE_S) for _ in range(2)]
    assert [(each["bench"], each["k"]) for each in got] == [("a", 4), ("b", 40)]
    feed.publish({"type": "live", "bench": "a", "k": 6})
    feed.unsubscribe(reader)
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(reader.get(), 0.05)
