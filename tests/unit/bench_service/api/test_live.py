"""The live feed over a WebSocket."""

import json
from types import SimpleNamespace
from typing import Any

from bench_service.api import live
from bench_service.campaign.live import Broadcaster
from tests.unit.bench_service.api.route_rig import client_of, websocket_talk

GONE = {"type": "websocket.disconnect", "code": 1001}


async def talk(feed: Any, *received: dict[str, Any]) -> list[Any]:
    bench = SimpleNamespace(summary=lambda: {"name": "sim", "state": "idle"})
    return await websocket_talk(client_of(live.router, live=feed, benches=[bench]).app, "/live", {}, *received)


class Chatty(Broadcaster):
    """A feed on which two messages wait as soon as anybody reads."""

    def subscribe(self, every_s: float = 0.0) -> Any:
        reader = super().subscribe(every_s)
        self.publish({"type": "sample", "voltage_V": 3.7})
        self.publish({"type": "event", "text": "rest"})
        return reader


async def test_first_the_state_of_every_bench_then_what_happens() -> None:
    text = {"type": "websocket.receive", "text": "ignored"}
    sent = await talk(Chatty(), text, text, text, text, GONE)
    assert sent[0]["type"] == "websocket.accept"
    messages = [json.loads(each["text"]) for each in sent[1:]]
    assert messages == [
        {"type": "bench", "name": "sim", "state": "idle"},
        {"type": "sample", "voltage_V": 3.7},
        {"type": "event", "text": "rest"},
    ]


async def test_a_reader_who_has_gone_gives_its_place_back() -> None:
    feed = Broadcaster(max_readers=1)
    for _ in range(3):
        assert (await talk(feed, GONE))[0]["type"] == "websocket.accept"


async def test_a_binary_message_ends_the_feed_and_gives_the_place_back() -> None:
    feed = Broadcaster(max_readers=1)
    await talk(feed, {"type": "websocket.receive", "bytes": b"x"}, GONE)
    assert feed.subscribe() is not None


async def test_one_reader_too_many_is_told_to_come_again() -> None:
    feed = Broadcaster(max_readers=1)
    feed.subscribe()
    sent = await talk(feed)
    assert [each["type"] for each in sent] == ["websocket.accept", "websocket.close"]
    assert sent[1]["code"] == 1013 and "1 readers are connected already" in sent[1]["reason"]
