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
